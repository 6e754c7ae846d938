from django.db import migrations, models


class Migration(migrations.Migration):

    dependencies = [
        ('devices', '0001_initial'),
    ]

    operations = [
        migrations.AddField(
            model_name='installation',
            name='next_token_sha256',
            field=models.CharField(editable=False, help_text='of a token given out and not used yet; with its first use it takes the place of the other', max_length=64, null=True, unique=True),
        ),
        migrations.AddField(
            model_name='installation',
            name='simulated',
            field=models.BooleanField(default=False, editable=False, help_text='made up, not measured: never part of the open data'),
        ),
    ]
