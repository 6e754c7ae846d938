from django.db import migrations, models

from tests.services.next_release.operations import killed_at, write_again


class Migration(migrations.Migration):
    dependencies = [("devices", "0001_release_1_0")]
    operations = [
        write_again("devices", "DeviceAlias"),
        migrations.AlterField("devicealias", "reason", models.CharField(max_length=120)),
        killed_at("devices"),
    ]
