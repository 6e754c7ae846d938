import django.core.validators
from django.db import migrations, models


class Migration(migrations.Migration):

    dependencies = [
        ("explorations", "0004_searched_once"),
    ]

    operations = [
        migrations.AddField(
            model_name="exploration",
            name="note",
            field=models.TextField(
                blank=True,
                default="",
                help_text="why it was paused by itself, or why a machine could not measure for it",
            ),
            preserve_default=False,
        ),
        migrations.AlterField(
            model_name="exploration",
            name="budget",
            field=models.PositiveIntegerField(
                validators=[
                    django.core.validators.MinValueValidator(1),
                    django.core.validators.MaxValueValidator(1000000),
                ]
            ),
        ),
    ]
