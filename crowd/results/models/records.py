"""Records of the server: erasures, when its tasks ran, and how many rows its tables have."""

import uuid

from django.db import models


class WorkerPulse(models.Model):
    """When each periodic task last ran, for /readyz."""

    task = models.CharField(max_length=100, unique=True)
    at = models.DateTimeField()

    def __str__(self) -> str:
        return f"{self.task} {self.at:%Y-%m-%d %H:%M:%S}"


class RowCount(models.Model):
    """How many rows a growing table had when a worker last counted them, for /metrics."""

    table = models.CharField(max_length=40, unique=True, help_text="as the metric calls it")
    rows = models.PositiveBigIntegerField()
    at = models.DateTimeField()
    seconds = models.FloatField(help_text="that counting took")

    def __str__(self) -> str:
        return f"{self.table}: {self.rows} at {self.at:%Y-%m-%d %H:%M:%S}"


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

    class Meta:
        ordering = ["erased_at", "id"]
        permissions = [("erase_measurements", "Can erase measurements of other people")]
        indexes = [models.Index(fields=["id"], name="tombstone_single", condition=models.Q(single=True))]

    def __str__(self) -> str:
        return f"{self.kind} {self.id}"
