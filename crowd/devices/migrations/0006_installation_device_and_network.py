"""An installation is one device, and knows the network it enrolled from as a keyed hash."""

import django.db.models.deletion
from django.db import migrations, models


class Migration(migrations.Migration):

    dependencies = [
        ('devices', '0005_simulated'),
    ]

    operations = [
        migrations.AddField(
            model_name='installation',
            name='description',
            field=models.ForeignKey(editable=False, help_text='how its device described itself first; an installation is one device', null=True, on_delete=django.db.models.deletion.SET_NULL, related_name='+', to='devices.devicedescription'),
        ),
        migrations.AddField(
            model_name='installation',
            name='network',
            field=models.CharField(blank=True, db_index=True, editable=False, help_text='keyed hash of the network (/24, /48) that it enrolled from; empty: not known', max_length=32),
        ),
    ]
