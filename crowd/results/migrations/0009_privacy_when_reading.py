"""Sessions and figures are stored under the model itself; figures know who agrees and what failed."""

import django.db.models.deletion
from django.db import migrations, models
from django.db.models import OuterRef, Subquery
from django.db.models.functions import Coalesce


def move_sessions(apps, schema_editor):
    """From the groups of rare models to the models themselves; what was derived under groups is made again."""
    session = apps.get_model("results", "MeasurementSession")
    description = apps.get_model("devices", "DeviceDescription")
    shown = description.objects.filter(pk=OuterRef("description")).values(
        shown=Coalesce("model__canonical", "model")
    )
    session.objects.filter(device__kind="group").update(
        device=Subquery(shown), summary_algorithm=None
    )
    for name in ("Cohort", "DeviceSpeedup", "DeviceActivity"):
        apps.get_model("results", name).objects.filter(device__kind="group").delete()
    # Who measured each model is counted again.
    apps.get_model("devices", "DeviceModel").objects.exclude(kind="group").update(changed=True)


class Migration(migrations.Migration):

    dependencies = [
        ('devices', '0007_masks_and_processors'),
        ('results', '0008_export_files'),
    ]

    operations = [
        migrations.RunPython(move_sessions, migrations.RunPython.noop),
    ]
