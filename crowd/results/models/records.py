"""Records of the server: erasures, exports, and when its tasks ran."""

import uuid

from django.db import models


class WorkerPulse(models.Model):
    """When each periodic task last ran, for /readyz."""

    task = models.CharField(max_length=100, unique=True)
    at = models.DateTimeField()

    def __str__(self) -> str:
        return f"{self.task} {self.at:%Y-%m-%d %H:%M:%S}"


class TombstoneQuerySet(models.QuerySet["Tombstone"]):
    """Records of what was erased."""

    def single_runs(self) -> "TombstoneQuerySet":
        """Runs that participants deleted individually, perhaps after they saw the result."""
        return self.filter(single=True)


class Tombstone(models.Model):
    """A record of an erasure: kind and time, and nothing about the participant.

    The digest shows owners of an earlier copy of the open data what to delete. It reveals nothing else,
    because ids are random.
    """

    class Kind(models.TextChoices):
        RUN = "run"
        SESSION = "session"
        INSTALLATION = "installation"

    id = models.UUIDField(primary_key=True, default=uuid.uuid4, editable=False)
    kind = models.CharField(max_length=12, choices=Kind.choices)
    id_sha256 = models.CharField(
        max_length=64,
        blank=True,
        help_text="SHA-256 of the id that the run or session had; empty for an installation",
    )
    single = models.BooleanField(
        default=False, help_text="a run that its participant deleted by itself, and not with everything"
    )
    erased_at = models.DateTimeField(db_index=True)

    objects = TombstoneQuerySet.as_manager()

    class Meta:
        ordering = ["erased_at", "id"]
        permissions = [("erase_measurements", "Can erase measurements of other people")]
        indexes = [models.Index(fields=["id"], name="tombstone_single", condition=models.Q(single=True))]

    def __str__(self) -> str:
        return f"{self.kind} {self.id}"


class Export(models.Model):
    """One export of the open data. Its files are in its own folder; each has a row of ExportFile."""

    started_at = models.DateTimeField(db_index=True)
    touched_at = models.DateTimeField(help_text="when its writer last made progress")
    published_at = models.DateTimeField(null=True)
    withdrawn_at = models.DateTimeField(
        null=True, help_text="an earlier version of this software withdrew it after an erasure"
    )
    last_session = models.BigIntegerField(
        default=0, help_text="primary key of the newest session that it covers"
    )
    last_run = models.BigIntegerField(default=0, help_text="primary key of the newest run that it covers")
    changed_while_written = models.BooleanField(
        default=False, help_text="something was erased while it was written, so all of its files are stale"
    )

    class Meta:
        ordering = ["-started_at", "-id"]

    def __str__(self) -> str:
        return f"{self.name} ({self.pk})"

    @property
    def name(self) -> str:
        """The day (UTC) of the export, which is part of its addresses."""
        return f"{self.started_at:%Y-%m-%d}"

    @property
    def folder(self) -> str:
        """The name of its folder, different from that of all other exports."""
        return f"{self.name}-{self.pk}"


class ExportFile(models.Model):
    """One file of an export: a table, or a part of a large table, in one format.

    A stale file still contains something that was erased. It is rewritten before it is served.
    """

    export = models.ForeignKey(Export, on_delete=models.CASCADE, related_name="files")
    table = models.CharField(max_length=20)
    part = models.PositiveSmallIntegerField(default=1, help_text="number within the table, from 1")
    format = models.CharField(max_length=10, help_text="parquet or csv")
    name = models.CharField(max_length=60, help_text="its name in addresses")
    stored_as = models.CharField(
        max_length=80, help_text="its name in the export's folder; it changes whenever the file is rewritten"
    )
    rows = models.PositiveBigIntegerField()
    bytes = models.PositiveBigIntegerField()
    sha256 = models.CharField(max_length=64)
    first_session = models.BigIntegerField(
        null=True, help_text="smallest primary key of the sessions in it; empty for tables without sessions"
    )
    last_session = models.BigIntegerField(null=True, help_text="largest primary key of those sessions")
    stale = models.BooleanField(default=False, help_text="it holds something that was erased since")
    marked = models.PositiveIntegerField(default=0, help_text="how often it was marked as stale")

    class Meta:
        ordering = ["id"]
        constraints = [
            models.UniqueConstraint(fields=["export", "name"], name="export_file_name"),
            models.UniqueConstraint(fields=["export", "table", "part", "format"], name="export_file_part"),
        ]
        indexes = [models.Index(fields=["export"], name="export_file_stale", condition=models.Q(stale=True))]

    def __str__(self) -> str:
        return f"{self.export_id} {self.name}"
