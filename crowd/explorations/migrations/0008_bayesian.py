from django.db import migrations, models

FORMER, PRESENT = "two-stage", "bayesian"
RETIRED = ("trees", "explore")  # options of the former method that mean nothing any more


def rename(apps, schema_editor):
    """The method keeps its explorations under its present name; a search goes on with new models."""
    Exploration = apps.get_model("explorations", "Exploration")
    for exploration in Exploration.objects.filter(method=FORMER).only("pk", "method", "options"):
        exploration.method = PRESENT
        exploration.options = {name: value for name, value in exploration.options.items() if name not in RETIRED}
        exploration.save(update_fields=["method", "options"])


def rename_back(apps, schema_editor):
    apps.get_model("explorations", "Exploration").objects.filter(method=PRESENT).update(method=FORMER)


class Migration(migrations.Migration):

    dependencies = [
        ("explorations", "0007_runtime_ratio"),
    ]

    operations = [
        migrations.AlterField(
            model_name="exploration",
            name="method",
            field=models.CharField(choices=[("bayesian", "bayesian"), ("algorithm1", "algorithm1"), ("random", "random")], default="bayesian", max_length=32),
        ),
        migrations.RunPython(rename, rename_back),
    ]
