from django.db import migrations, models

from tests.services.next_release.operations import killed_at, write_again


class Migration(migrations.Migration):
    dependencies = [("results", "0001_release_1_0"), ("devices", "next")]
    operations = [
        write_again("results", "Decision"),
        migrations.AddField("decision", "note", models.CharField(max_length=20, default="none")),
        migrations.AlterField("decision", "reason", models.TextField()),
        killed_at("results"),
    ]
