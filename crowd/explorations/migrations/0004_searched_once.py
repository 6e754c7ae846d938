from django.db import migrations, models


class Migration(migrations.Migration):

    dependencies = [
        ('explorations', '0003_iterations'),
    ]

    operations = [
        migrations.RemoveField(
            model_name='exploration',
            name='search',
        ),
        migrations.AddConstraint(
            model_name='evaluation',
            constraint=models.UniqueConstraint(condition=models.Q(('phase__in', ['random', 'active'])), fields=('exploration', 'index'), name='evaluation_searched_once'),
        ),
    ]
