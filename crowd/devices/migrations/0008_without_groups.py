"""Rare models are masked when they are read: the rows that stood for groups of them go."""

from django.db import migrations, models


def delete_groups(apps, schema_editor):
    device_model = apps.get_model("devices", "DeviceModel")
    device_model.objects.exclude(group=None).update(group=None)
    device_model.objects.filter(kind="group").delete()


class Migration(migrations.Migration):

    dependencies = [
        ('devices', '0007_masks_and_processors'),
        ('results', '0009_privacy_when_reading'),
    ]

    operations = [
        migrations.RunPython(delete_groups, migrations.RunPython.noop),
        migrations.RemoveField(
            model_name='devicemodel',
            name='group',
        ),
        migrations.AlterField(
            model_name='devicemodel',
            name='kind',
            field=models.CharField(choices=[('device', 'Device'), ('unknown', 'unknown device'), ('emulator', 'Emulator'), ('virtual', 'virtual machine'), ('simulated', 'Simulated')], default='device', max_length=10),
        ),
    ]
