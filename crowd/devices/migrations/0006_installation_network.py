from django.db import migrations, models


class Migration(migrations.Migration):
    dependencies = [
        ("devices", "0005_simulated"),
    ]

    operations = [
        migrations.AddField(
            model_name="installation",
            name="network",
            field=models.CharField(blank=True, db_index=True, max_length=32),
        ),
    ]
