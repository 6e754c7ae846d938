"""Simulated devices: models of a kind of their own."""

from django.db import migrations, models


class Migration(migrations.Migration):

    dependencies = [
        ('devices', '0004_keys_of_groups'),
    ]

    operations = [
        migrations.AddField(
            model_name='devicedescription',
            name='simulated',
            field=models.BooleanField(default=False, editable=False, help_text='sent by a simulated installation: its model is simulated'),
        ),
        migrations.AlterField(
            model_name='devicemodel',
            name='kind',
            field=models.CharField(choices=[('device', 'Device'), ('unknown', 'unknown device'), ('emulator', 'Emulator'), ('virtual', 'virtual machine'), ('group', 'group of rare models'), ('simulated', 'Simulated')], default='device', max_length=10),
        ),
    ]
