"""What the server writes down of its own doings: erasures, exports, when its tasks ran."""

import uuid

from django.db import models


class WorkerPulse(models.Model):
    """When each periodic task last ran, for /readyz."""

    task = models.CharField(max_length=100, unique=True)
    at = models.DateTimeField()

    def __str__(self) -> str:
        return f"{self.task} {self.at:%Y-%m-%d %H:%M:%S}"


class Tombstone(models.Model):
    """What remains of something erased: that it was, of which kind and when, and nothing of whom.

    The digest tells those who hold an earlier copy of the open data what to delete, and nobody else anything:
    ids are random.
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
    erased_at = models.DateTimeField(db_index=True)

    class Meta:
        ordering = ["erased_at", "id"]

    def __str__(self) -> str:
        return f"{self.kind} {self.id}"


class Export(models.Model):
    """One export of the open data. Its files lie in a folder of their own; the row says if they count."""

    started_at = models.DateTimeField(db_index=True)
    touched_at = models.DateTimeField(help_text="while it is being written: when that went on last")
    published_at = models.DateTimeField(null=True)
    withdrawn_at = models.DateTimeField(
        null=True, help_text="something in it was erased: its files are deleted"
    )
    files = models.JSONField(default=list, help_text="name, table, format, rows, bytes, sha256")

    class Meta:
        ordering = ["-started_at", "-id"]

    def __str__(self) -> str:
        return f"{self.name} ({self.pk})"

    @property
    def name(self) -> str:
        """The day (UTC) it was made on: its place in addresses."""
        return f"{self.started_at:%Y-%m-%d}"

    @property
    def folder(self) -> str:
        """The name of its folder, which no other export has."""
        return f"{self.name}-{self.pk}"
