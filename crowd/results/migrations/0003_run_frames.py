import django.db.models.deletion
from django.db import migrations, models

from crowd.results.intake import packing

BATCH = 1_000


def move_series(apps, editor):
    """Compress the series of all runs into the new table."""
    # A move to another database migrates that one.
    runs, frames = (
        apps.get_model("results", name).objects.using(editor.connection.alias) for name in ("Run", "RunFrames")
    )
    last = 0
    columns = ("pk", "frame_us", "stages", "stages_us", "tracked")
    while rows := list(runs.filter(pk__gt=last).order_by("pk").values_list(*columns)[:BATCH]):
        series = {
            key: packing.Series(bytes(frame_us), stages, bytes(stages_us), bytes(tracked))
            for key, frame_us, stages, stages_us, tracked in rows
        }
        frames.bulk_create(
            frames.model(run_id=key, size=each.size, content=packing.compress(each)) for key, each in series.items()
        )
        last = rows[-1][0]


class Migration(migrations.Migration):
    dependencies = [("results", "0002_rowcount")]

    operations = [
        migrations.CreateModel(
            name="RunFrames",
            fields=[
                (
                    "run",
                    models.OneToOneField(
                        on_delete=django.db.models.deletion.CASCADE,
                        primary_key=True,
                        related_name="frames",
                        serialize=False,
                        to="results.run",
                    ),
                ),
                (
                    "size",
                    models.PositiveIntegerField(help_text="bytes of the series before compression"),
                ),
                (
                    "content",
                    models.BinaryField(help_text="as crowd.results.intake.packing compresses it"),
                ),
            ],
            options={"verbose_name_plural": "run frames"},
        ),
        migrations.RunPython(move_series),
        migrations.RemoveField("run", "frame_us"),
        migrations.RemoveField("run", "stages"),
        migrations.RemoveField("run", "stages_us"),
        migrations.RemoveField("run", "tracked"),
    ]
