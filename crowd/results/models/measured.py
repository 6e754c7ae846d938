"""Measurements as they were sent, and the decisions of administrators on them.

The mean, fingerprint, state and reason of a run are derived.
"""

import uuid

from django.db import models

from crowd.devices.models import DeviceDescription, DeviceModel, Installation, ProcessorClass
from crowd.fronts.models import Configuration, FrontVersion


class State(models.TextChoices):
    """Whether a measurement counts. crowd.results.validity.rules contains the rules.

    Pending: not judged yet. Suspect: counts only if there is no valid one. Quarantined: does not count until
    the reason is gone. Invalid: never counts.
    """

    PENDING = "pending"
    VALID = "valid"
    SUSPECT = "suspect"
    INVALID = "invalid"
    QUARANTINED = "quarantined"


class Submission(models.Model):
    """One accepted request. Its key and the digest of its body make repeated requests idempotent."""

    id = models.UUIDField(primary_key=True, default=uuid.uuid4, editable=False)
    installation = models.ForeignKey(Installation, on_delete=models.CASCADE, related_name="submissions")
    idempotency_key = models.CharField(max_length=128)
    body_sha256 = models.CharField(max_length=64)
    answer = models.TextField(help_text="the JSON that the client was told, told again on a replay")
    schema_version = models.PositiveSmallIntegerField()
    app_version = models.CharField(max_length=32)
    consent_version = models.PositiveSmallIntegerField()
    received_at = models.DateTimeField(auto_now_add=True, db_index=True)
    extra = models.JSONField(default=dict, blank=True, help_text="members that this version does not know")

    class Meta:
        ordering = ["-received_at"]
        constraints = [
            models.UniqueConstraint(
                fields=["installation", "idempotency_key"], name="submission_idempotency_key"
            ),
        ]

    def __str__(self) -> str:
        return str(self.id)


class MeasurementSession(models.Model):
    """Runs of several configurations, one after another on one device. Comparisons are within a session."""

    class StageClock(models.TextChoices):
        """The clock of the stage times."""

        DEVICE = "device"
        WALL = "wall"
        NONE = "none"

    uuid = models.UUIDField(unique=True, help_text="given by the client")
    installation = models.ForeignKey(Installation, on_delete=models.CASCADE, related_name="sessions")
    submission = models.ForeignKey(Submission, on_delete=models.CASCADE, related_name="sessions")
    description = models.ForeignKey(
        DeviceDescription, on_delete=models.PROTECT, related_name="sessions", db_index=False
    )
    device = models.ForeignKey(
        DeviceModel,
        on_delete=models.PROTECT,
        related_name="sessions",
        help_text="the model it counts for: the description's, or the one that is an alias of",
    )
    front = models.ForeignKey(FrontVersion, on_delete=models.PROTECT, related_name="sessions")
    protocol_version = models.PositiveSmallIntegerField()
    backend = models.CharField(max_length=32)
    processor = models.CharField(
        max_length=200, blank=True, help_text="the chip that computed, as the rules call it"
    )
    processor_class = models.CharField(max_length=3, choices=ProcessorClass.choices, default="gpu")
    driver = models.CharField(max_length=200, blank=True)
    started_at = models.DateTimeField()
    received_at = models.DateTimeField(auto_now_add=True)
    empty_frame_us = models.FloatField(
        null=True, blank=True, help_text="what an empty frame costs on its backend"
    )
    stage_clock = models.CharField(  # noqa: DJ001 - without null SQLite would copy the whole table
        max_length=8,
        choices=StageClock.choices,
        null=True,
        blank=True,
        help_text="what took the times of the stages",
    )
    threads = models.PositiveSmallIntegerField(
        null=True, blank=True, help_text="that computed with WebAssembly; empty for other backends"
    )
    blocks_repeated = models.PositiveSmallIntegerField(
        null=True,
        blank=True,
        help_text="blocks of runs measured again because other programs disturbed them; empty: not said",
    )
    samples = models.JSONField(
        default=list, help_text="temperature, clock and battery, at most once a second"
    )
    extra = models.JSONField(default=dict, blank=True, help_text="members that this version does not know")
    summary_algorithm = models.PositiveSmallIntegerField(
        null=True,
        editable=False,
        help_text="version of the statistics that has seen all runs; empty: waiting for its task",
    )

    class Meta:
        ordering = ["-id"]
        indexes = [
            models.Index(fields=["summary_algorithm", "id"], name="session_waiting"),
            # Finds quickly whether a description has a session of a device.
            models.Index(fields=["description", "device"], name="session_description"),
            models.Index(fields=["device", "-id"], name="session_device_newest"),
            models.Index(fields=["device", "installation", "started_at"], name="session_device_activity"),
            # The order of the lists of sessions and runs, with the columns that filter them.
            models.Index(fields=["-started_at", "-id", "device", "front", "backend"], name="session_listed"),
        ]

    def __str__(self) -> str:
        return str(self.uuid)


class Run(models.Model):
    """One run of a configuration over the sequence. What it measured in each frame is in its RunFrames."""

    class Status(models.TextChoices):
        OK = "ok"
        FAILED = "failed"

    uuid = models.UUIDField(unique=True, help_text="given by the client")
    session = models.ForeignKey(MeasurementSession, on_delete=models.CASCADE, related_name="runs")
    configuration = models.ForeignKey(Configuration, on_delete=models.PROTECT, related_name="runs")
    repeat = models.PositiveSmallIntegerField(help_text="which run of this configuration in the session")
    order = models.PositiveSmallIntegerField(help_text="place among all runs of the session")
    status = models.CharField(max_length=8, choices=Status.choices)
    failure = models.CharField(max_length=500, blank=True)
    tracked_frames = models.PositiveSmallIntegerField(null=True, blank=True)
    mean_us = models.FloatField(
        null=True, blank=True, help_text="mean over the counted frames; the run's value"
    )
    cpu_us = models.BigIntegerField(
        null=True, blank=True, help_text="of the processor over all threads and the counted frames"
    )
    waited_us = models.BigIntegerField(
        null=True,
        blank=True,
        help_text="threads stood ready without a processor, over the counted frames",
    )
    ate_max = models.FloatField(null=True, blank=True, help_text="m")
    ate_mean = models.FloatField(null=True, blank=True, help_text="m")
    ate_rmse = models.FloatField(null=True, blank=True, help_text="m")
    trajectory_sha256 = models.CharField(max_length=64, blank=True)
    deviation = models.FloatField(
        null=True,
        blank=True,
        help_text="m, largest distance of a position from the reference trajectory",
    )
    extra = models.JSONField(default=dict, blank=True, help_text="members that this version does not know")
    fingerprint = models.BigIntegerField(
        null=True,
        db_index=True,
        editable=False,
        help_text="digest of the frames' times, where they vary enough to be nobody else's",
    )
    state = models.CharField(max_length=16, choices=State.choices)
    reason = models.CharField(max_length=64, blank=True, help_text="code of the rule that set the state")

    class Meta:
        ordering = ["session_id", "order"]
        constraints = [
            models.UniqueConstraint(fields=["session", "configuration", "repeat"], name="run_repeat"),
        ]
        indexes = [
            # Finds the few runs that do not count.
            models.Index(fields=["session"], name="run_not_valid", condition=~models.Q(state="valid")),
        ]

    def __str__(self) -> str:
        return str(self.uuid)


class RunFrames(models.Model):
    """The times of a run's frames and of their stages, and whether each was tracked. Never updated.

    A table of its own: a run is updated when it is judged, and databases write whole rows.
    """

    run = models.OneToOneField(Run, on_delete=models.CASCADE, primary_key=True, related_name="frames")
    size = models.PositiveIntegerField(help_text="bytes of the series before compression")
    content = models.BinaryField(help_text="as crowd.results.intake.packing compresses it")

    class Meta:
        verbose_name_plural = "run frames"

    def __str__(self) -> str:
        return f"frames of {self.run_id}"


class Decision(models.Model):
    """An administrator's decision on a session or a run. The newest one applies. Never edited."""

    class Action(models.TextChoices):
        QUARANTINE = "quarantine"
        RELEASE = "release"

    at = models.DateTimeField(auto_now_add=True)
    actor = models.CharField(max_length=150, help_text="user name")
    action = models.CharField(max_length=16, choices=Action.choices)
    reason = models.CharField(max_length=500)
    session = models.ForeignKey(MeasurementSession, on_delete=models.CASCADE, related_name="decisions")
    run = models.ForeignKey(
        Run,
        on_delete=models.CASCADE,
        null=True,
        blank=True,
        related_name="decisions",
        help_text="empty: the whole session",
    )

    class Meta:
        ordering = ["-id"]

    def __str__(self) -> str:
        return f"{self.action} by {self.actor}"
