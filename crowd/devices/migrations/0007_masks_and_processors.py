"""Models are masked when they are read; descriptions say which chip computed; one counter of changes."""

from django.db import migrations, models

import crowd.devices.models


def give_masks(apps, schema_editor):
    """A default is made once for all rows; each needs one of its own."""
    device_model = apps.get_model("devices", "DeviceModel")
    rows = []
    for row in device_model.objects.only("pk").iterator():
        row.mask = crowd.devices.models.new_mask()
        rows.append(row)
    device_model.objects.bulk_update(rows, ["mask"], batch_size=500)


class Migration(migrations.Migration):

    dependencies = [
        ('devices', '0006_installation_device_and_network'),
    ]

    operations = [
        migrations.CreateModel(
            name='Revision',
            fields=[
                ('id', models.BigAutoField(auto_created=True, primary_key=True, serialize=False, verbose_name='ID')),
            ],
        ),
        migrations.AddField(
            model_name='devicedescription',
            name='processor',
            field=models.CharField(blank=True, help_text='the chip that computed, as the rules call it', max_length=200),
        ),
        migrations.AddField(
            model_name='devicedescription',
            name='processor_class',
            field=models.CharField(choices=[('cpu', 'Cpu'), ('gpu', 'Gpu')], default='gpu', max_length=3),
        ),
        migrations.AddField(
            model_name='devicemodel',
            name='consented',
            field=models.BooleanField(default=False, help_text='everybody who measured it agreed that it is named, however rare it is'),
        ),
        migrations.AddField(
            model_name='devicemodel',
            name='mask',
            field=models.CharField(default=crowd.devices.models.new_mask, editable=False, help_text='the end of a masked address', max_length=12),
        ),
        migrations.RunPython(give_masks, migrations.RunPython.noop),
        migrations.AlterField(
            model_name='devicemodel',
            name='mask',
            field=models.CharField(default=crowd.devices.models.new_mask, editable=False, help_text='the end of a masked address', max_length=12, unique=True),
        ),
        migrations.AddField(
            model_name='devicemodel',
            name='named',
            field=models.BooleanField(default=False, help_text='a rule, the catalogue or an administrator knows the name'),
        ),
        migrations.AddField(
            model_name='devicemodel',
            name='published_slug',
            field=models.CharField(blank=True, editable=False, help_text='the address in the open data written so far', max_length=120),
        ),
        migrations.AlterField(
            model_name='devicemodel',
            name='changed',
            field=models.BooleanField(default=True, editable=False, help_text='its descriptions or kind changed: sessions have to follow'),
        ),
        migrations.AlterField(
            model_name='devicemodel',
            name='rare',
            field=models.BooleanField(default=True, help_text='measured by too few installations to be named'),
        ),
    ]
