"""Exports of the open data and their files."""

from django.db import models

LATEST = "latest"


class Export(models.Model):
    """One export of the open data. `day` is its address: the first export of a day has it.

    A release stays. Of another export only this row is left once newer ones replaced it.
    """

    started_at = models.DateTimeField(db_index=True)
    touched_at = models.DateTimeField(help_text="when its writer last made progress")
    published_at = models.DateTimeField(null=True)
    removed_at = models.DateTimeField(
        null=True, help_text="when its files were deleted; its address names the release with its data"
    )
    day = models.DateField(
        null=True, unique=True, help_text="the day in its address; empty if an earlier export has it"
    )
    release = models.BooleanField(
        default=False, help_text="it can be cited: its address answers as long as the server lives"
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
        permissions = [("release_export", "Can make an export a release")]

    def __str__(self) -> str:
        return f"{self.name} ({self.pk})"

    @property
    def name(self) -> str:
        """Its name in addresses."""
        return LATEST if self.day is None else self.day.isoformat()


class StoredFile(models.Model):
    """A file of the open data: a table, a part of a large table, or a description, in one format.

    Exports whose file has the same content share it. A stale file still contains something that was erased.
    It is rewritten before it is served.
    """

    class Reason(models.TextChoices):
        """Why a file is stale."""

        ERASURE = "erasure", "something was erased"
        DEVICE_NAMES = "device names", "names of devices changed"

    table = models.CharField(max_length=20, help_text="the name of a description")
    format = models.CharField(max_length=10, help_text="parquet, csv, json, text or python")
    stored_as = models.CharField(
        max_length=100, db_index=True, help_text="its name in the folder of the open data, with its digest"
    )
    rows = models.PositiveBigIntegerField(null=True)
    bytes = models.PositiveBigIntegerField()
    sha256 = models.CharField(max_length=64)
    first_session = models.BigIntegerField(
        null=True, help_text="smallest primary key of the sessions in it; empty for tables without sessions"
    )
    last_session = models.BigIntegerField(null=True, help_text="largest primary key of those sessions")
    until_session = models.BigIntegerField(
        default=0, help_text="primary key of the newest session that its first export covers"
    )
    until_run = models.BigIntegerField(
        default=0, help_text="the same of the newest run; in a part of the runs, its last one"
    )
    stale = models.BooleanField(default=False, help_text="it holds something that was erased since")
    reason = models.CharField(max_length=20, choices=Reason.choices, blank=True, help_text="why it is stale")
    marked = models.PositiveIntegerField(default=0, help_text="how often it was marked as stale")

    class Meta:
        ordering = ["id"]
        indexes = [models.Index(fields=["id"], name="stored_file_stale", condition=models.Q(stale=True))]

    def __str__(self) -> str:
        return self.stored_as


class ExportFiles(models.Manager["ExportFile"]):
    """Names with their stored files, in one query."""

    def get_queryset(self) -> models.QuerySet["ExportFile"]:
        return super().get_queryset().select_related("stored")


class ExportFile(models.Model):
    """The name of a stored file in an export. `part`: its number within the table, from 1."""

    export = models.ForeignKey(Export, on_delete=models.CASCADE, related_name="files")
    stored = models.ForeignKey(StoredFile, on_delete=models.CASCADE, related_name="uses")
    name = models.CharField(max_length=60, help_text="its name in addresses")
    part = models.PositiveSmallIntegerField(default=1, help_text="number within the table, from 1")

    objects = ExportFiles()

    class Meta:
        ordering = ["id"]
        constraints = [models.UniqueConstraint(fields=["export", "name"], name="export_file_name")]

    def __str__(self) -> str:
        return f"{self.export_id} {self.name}"


class FileChange(models.Model):
    """A stored file was rewritten: why, and its digest before and after."""

    stored = models.ForeignKey(StoredFile, on_delete=models.CASCADE, related_name="changes")
    at = models.DateTimeField()
    reason = models.CharField(max_length=20, choices=StoredFile.Reason.choices)
    old_sha256 = models.CharField(max_length=64)
    new_sha256 = models.CharField(max_length=64)

    class Meta:
        ordering = ["-id"]

    def __str__(self) -> str:
        return f"{self.stored} {self.reason}"
