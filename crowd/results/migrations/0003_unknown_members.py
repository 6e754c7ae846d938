from django.db import migrations, models


def kept():
    return models.JSONField(blank=True, default=dict, help_text="members that this version does not know")


class Migration(migrations.Migration):
    dependencies = [
        ("results", "0002_open_data"),
    ]

    operations = [
        migrations.AddField(model_name="submission", name="extra", field=kept()),
        migrations.AddField(model_name="measurementsession", name="extra", field=kept()),
        migrations.AddField(model_name="run", name="extra", field=kept()),
    ]
