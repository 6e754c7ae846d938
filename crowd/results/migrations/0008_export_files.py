"""Files of exports become rows, so that each of them can be marked as stale by itself."""

import django.db.models.deletion
from django.db import migrations, models

# Tables whose rows belong to sessions.
OF_SESSIONS = ("runs", "sessions", "summaries")


def store_files(apps, schema_editor):
    """A row for each table file of the exports that are served; the last rows that they cover."""
    export_model = apps.get_model("results", "Export")
    sessions = apps.get_model("results", "MeasurementSession").objects
    runs = apps.get_model("results", "Run").objects
    files = apps.get_model("results", "ExportFile").objects
    for export in export_model.objects.filter(withdrawn_at=None).exclude(published_at=None):
        covered = sessions.filter(received_at__lte=export.started_at)
        export.last_session = newest(covered)
        export.last_run = newest(runs.filter(session_id__lte=export.last_session))
        export.save(update_fields=["last_session", "last_run"])
        for file in export.listed_files:
            if file["table"] is None:  # written for each answer now
                continue
            covers = file["table"] in OF_SESSIONS
            files.create(
                export=export,
                stored_as=file["name"],
                first_session=0 if covers else None,
                last_session=export.last_session if covers else None,
                **{name: file[name] for name in ("name", "table", "format", "rows", "bytes", "sha256")},
            )
    # PostgreSQL alters no table whose foreign keys are still to be checked.
    schema_editor.connection.check_constraints()


def newest(rows):
    return rows.order_by("-pk").values_list("pk", flat=True).first() or 0


class Migration(migrations.Migration):
    dependencies = [
        ("results", "0007_pending"),
    ]

    operations = [
        migrations.AlterModelOptions(
            name="tombstone",
            options={
                "ordering": ["erased_at", "id"],
                "permissions": [("erase_measurements", "Can erase measurements of other people")],
            },
        ),
        migrations.AddField(
            model_name="tombstone",
            name="single",
            field=models.BooleanField(
                default=False,
                help_text="a run that its participant deleted by itself, and not with everything",
            ),
        ),
        migrations.AddIndex(
            model_name="tombstone",
            index=models.Index(
                condition=models.Q(("single", True)), fields=["id"], name="tombstone_single"
            ),
        ),
        # `files` becomes the name of the rows.
        migrations.RenameField(model_name="export", old_name="files", new_name="listed_files"),
        migrations.AddField(
            model_name="export",
            name="last_session",
            field=models.BigIntegerField(
                default=0, help_text="primary key of the newest session that it covers"
            ),
        ),
        migrations.AddField(
            model_name="export",
            name="last_run",
            field=models.BigIntegerField(default=0, help_text="primary key of the newest run that it covers"),
        ),
        migrations.AddField(
            model_name="export",
            name="changed_while_written",
            field=models.BooleanField(
                default=False,
                help_text="something was erased while it was written, so all of its files are stale",
            ),
        ),
        migrations.AlterField(
            model_name="export",
            name="touched_at",
            field=models.DateTimeField(help_text="when its writer last made progress"),
        ),
        migrations.AlterField(
            model_name="export",
            name="withdrawn_at",
            field=models.DateTimeField(
                help_text="an earlier version of this software withdrew it after an erasure", null=True
            ),
        ),
        migrations.CreateModel(
            name="ExportFile",
            fields=[
                (
                    "id",
                    models.BigAutoField(
                        auto_created=True, primary_key=True, serialize=False, verbose_name="ID"
                    ),
                ),
                ("table", models.CharField(max_length=20)),
                (
                    "part",
                    models.PositiveSmallIntegerField(default=1, help_text="number within the table, from 1"),
                ),
                ("format", models.CharField(help_text="parquet or csv", max_length=10)),
                ("name", models.CharField(help_text="its name in addresses", max_length=60)),
                (
                    "stored_as",
                    models.CharField(
                        help_text="its name in the export's folder; it changes whenever the file is rewritten",
                        max_length=80,
                    ),
                ),
                ("rows", models.PositiveBigIntegerField()),
                ("bytes", models.PositiveBigIntegerField()),
                ("sha256", models.CharField(max_length=64)),
                (
                    "first_session",
                    models.BigIntegerField(
                        help_text="smallest primary key of the sessions in it; empty for tables without sessions",
                        null=True,
                    ),
                ),
                (
                    "last_session",
                    models.BigIntegerField(help_text="largest primary key of those sessions", null=True),
                ),
                (
                    "stale",
                    models.BooleanField(
                        default=False, help_text="it holds something that was erased since"
                    ),
                ),
                (
                    "marked",
                    models.PositiveIntegerField(default=0, help_text="how often it was marked as stale"),
                ),
                (
                    "export",
                    models.ForeignKey(
                        on_delete=django.db.models.deletion.CASCADE,
                        related_name="files",
                        to="results.export",
                    ),
                ),
            ],
            options={
                "ordering": ["id"],
                "indexes": [
                    models.Index(
                        condition=models.Q(("stale", True)), fields=["export"], name="export_file_stale"
                    )
                ],
                "constraints": [
                    models.UniqueConstraint(fields=("export", "name"), name="export_file_name"),
                    models.UniqueConstraint(
                        fields=("export", "table", "part", "format"), name="export_file_part"
                    ),
                ],
            },
        ),
        migrations.RunPython(store_files, migrations.RunPython.noop),
        migrations.RemoveField(model_name="export", name="listed_files"),
    ]
