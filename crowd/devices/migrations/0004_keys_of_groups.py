"""A device whose maker is called "group" had the key of a group: groups get keys that no device can have."""

from django.db import migrations
from django.db.models import Q

EARLIER, PRESENT = "group|", "group\n"


def apart(apps, schema_editor):
    models = apps.get_model("devices", "DeviceModel")
    descriptions = apps.get_model("devices", "DeviceDescription")
    groups = models.objects.filter(Q(kind="group") | Q(rare_models__isnull=False), key__startswith=EARLIER)
    for group in groups.distinct():
        group.key = PRESENT + group.key.removeprefix(EARLIER)
        group.kind, group.group, group.rare = "group", None, False
        group.save(update_fields=["key", "kind", "group", "rare"])
        # What had taken its place is derived again by a worker, and gets a model of its own.
        descriptions.objects.filter(model=group).update(rules=0)


def together(apps, schema_editor):
    models = apps.get_model("devices", "DeviceModel")
    for group in models.objects.filter(key__startswith=PRESENT):
        group.key = EARLIER + group.key.removeprefix(PRESENT)
        group.save(update_fields=["key"])


class Migration(migrations.Migration):

    dependencies = [
        ('devices', '0003_models_and_decisions'),
    ]

    operations = [
        migrations.RunPython(apart, together),
    ]
