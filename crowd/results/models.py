"""What the crowd measured, as it arrived, and the summaries that tasks derive from it.

Submission, MeasurementSession and Run are raw; of a run, mean, fingerprint, state and reason are derived.
Cohort, SessionSummary, DeviceSpeedup and DeviceActivity are derived altogether: they can be deleted and
computed again from the raw rows and the Decisions of administrators.
"""

import uuid

from django.db import models

from crowd.devices.models import DeviceDescription, DeviceModel, Installation
from crowd.fronts.models import Configuration, FrontVersion


class State(models.TextChoices):
    """Whether a measurement counts; crowd.results.rules has the rules that decide.

    Suspect ones make a figure only where there is no valid one. Quarantined ones never do, until what hides
    them is gone. Invalid ones never do.
    """

    VALID = "valid"
    SUSPECT = "suspect"
    INVALID = "invalid"
    QUARANTINED = "quarantined"


class Submission(models.Model):
    """One accepted request. Its key and its body's digest make a repeated request change nothing."""

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
    """Runs of several configurations, one after another on one device: the unit of every comparison."""

    uuid = models.UUIDField(unique=True, help_text="given by the client")
    installation = models.ForeignKey(Installation, on_delete=models.CASCADE, related_name="sessions")
    submission = models.ForeignKey(Submission, on_delete=models.CASCADE, related_name="sessions")
    description = models.ForeignKey(
        DeviceDescription, on_delete=models.PROTECT, related_name="sessions", db_index=False
    )
    device = models.ForeignKey(DeviceModel, on_delete=models.PROTECT, related_name="sessions")
    front = models.ForeignKey(FrontVersion, on_delete=models.PROTECT, related_name="sessions")
    protocol_version = models.PositiveSmallIntegerField()
    backend = models.CharField(max_length=32)
    processor = models.CharField(max_length=200, blank=True, help_text="the OpenCL device that computed")
    platform = models.CharField(max_length=200, blank=True)
    driver = models.CharField(max_length=200, blank=True)
    started_at = models.DateTimeField()
    received_at = models.DateTimeField(auto_now_add=True)
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
            # Whether a description has a session under a name is one look, however many sessions there are.
            models.Index(fields=["description", "device"], name="session_description"),
            models.Index(fields=["device", "-id"], name="session_device_newest"),
            models.Index(fields=["device", "installation", "started_at"], name="session_device_activity"),
        ]

    def __str__(self) -> str:
        return str(self.uuid)


class Run(models.Model):
    """One configuration over the whole sequence; its times are packed as `crowd.results.packing` says."""

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
    frame_us = models.BinaryField(help_text="computation wall time of each frame")
    stages = models.JSONField(default=list, help_text="names of the stages, in the order of stages_us")
    stages_us = models.BinaryField(default=bytes, help_text="one series per stage, one after another")
    tracked = models.BinaryField(
        default=bytes, help_text="one byte a frame: 1 tracked, 0 lost, 2 neither; empty: not told"
    )
    tracked_frames = models.PositiveSmallIntegerField(null=True, blank=True)
    mean_us = models.FloatField(
        null=True, blank=True, help_text="mean over the counted frames; the run's value"
    )
    ate_max = models.FloatField(null=True, blank=True, help_text="m")
    ate_mean = models.FloatField(null=True, blank=True, help_text="m")
    ate_rmse = models.FloatField(null=True, blank=True, help_text="m")
    trajectory_sha256 = models.CharField(max_length=64, blank=True)
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

    def __str__(self) -> str:
        return str(self.uuid)


class Decision(models.Model):
    """What an administrator decided on a session or on one run: the newest decision holds. Never edited."""

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


class Cohort(models.Model):
    """Sessions that may be averaged with each other: of one device model, front, backend and processor.

    Who writes summaries of its sessions, or figures from them, holds a lock on its row.
    """

    device = models.ForeignKey(DeviceModel, on_delete=models.CASCADE, related_name="cohorts")
    front = models.ForeignKey(FrontVersion, on_delete=models.CASCADE, related_name="cohorts")
    backend = models.CharField(max_length=32)
    processor = models.CharField(max_length=200, blank=True, help_text="the OpenCL device that computed")
    stale = models.BooleanField(default=False, help_text="its figures do not know its newest sessions yet")

    class Meta:
        constraints = [
            models.UniqueConstraint(fields=["device", "front", "backend", "processor"], name="cohort_key"),
        ]
        indexes = [
            models.Index(fields=["id"], name="cohort_stale", condition=models.Q(stale=True)),
        ]

    def __str__(self) -> str:
        return f"{self.device_id} {self.front_id} {self.backend} {self.processor}"


class SessionSummary(models.Model):
    """One session's answer for one configuration: the mean of its paired log ratios over the baseline."""

    cohort = models.ForeignKey(Cohort, on_delete=models.CASCADE, related_name="summaries")
    installation = models.ForeignKey(Installation, on_delete=models.CASCADE, related_name="+")
    session = models.ForeignKey(MeasurementSession, on_delete=models.CASCADE, related_name="summaries")
    configuration = models.ForeignKey(Configuration, on_delete=models.CASCADE, related_name="+")
    baseline = models.ForeignKey(Configuration, on_delete=models.CASCADE, related_name="+")
    algorithm = models.PositiveSmallIntegerField()
    log_ratio = models.FloatField(
        null=True, help_text="natural logarithm of the speedup; empty where no pair is valid"
    )
    pairs = models.PositiveSmallIntegerField()
    drift = models.FloatField(
        null=True, help_text="largest ratio of the last repeat over the first, frame by frame"
    )
    ate_max = models.FloatField(null=True, help_text="largest ATE of the configuration's runs, m")
    state = models.CharField(max_length=16, choices=State.choices)
    reason = models.CharField(max_length=64, blank=True, help_text="code of the rule that set the state")
    started_at = models.DateTimeField(help_text="the session's")
    day = models.DateField(help_text="of started_at, UTC")
    counted = models.BooleanField(
        help_text="among the first sessions of its installation and day that have its state"
    )

    class Meta:
        verbose_name_plural = "session summaries"
        indexes = [
            models.Index(fields=["cohort", "installation", "day"], name="summary_day"),
            models.Index(fields=["cohort", "configuration", "log_ratio"], name="summary_log_ratio"),
            # All that the figures of a period are made of: they are read from here alone, which takes the
            # condition's column too.
            models.Index(
                fields=[
                    "configuration",
                    "cohort",
                    "baseline",
                    "installation",
                    "state",
                    "started_at",
                    "log_ratio",
                    "ate_max",
                    "counted",
                ],
                name="summary_period",
                condition=models.Q(counted=True),
            ),
        ]
        constraints = [
            models.UniqueConstraint(fields=["session", "configuration"], name="session_summary_key"),
        ]

    def __str__(self) -> str:
        return f"{self.session_id} {self.configuration_id}"


class DeviceSpeedup(models.Model):
    """The published figure: how much faster one configuration runs than the baseline on one device model."""

    device = models.ForeignKey(DeviceModel, on_delete=models.CASCADE, related_name="speedups")
    front = models.ForeignKey(FrontVersion, on_delete=models.CASCADE, related_name="speedups")
    configuration = models.ForeignKey(Configuration, on_delete=models.CASCADE, related_name="speedups")
    baseline = models.ForeignKey(Configuration, on_delete=models.CASCADE, related_name="+")
    backend = models.CharField(max_length=32)
    processor = models.CharField(max_length=200, blank=True)
    algorithm = models.PositiveSmallIntegerField()
    speedup = models.FloatField()
    low = models.FloatField(null=True, help_text="95 % interval over installations, from 3 of them on")
    high = models.FloatField(null=True)
    repeat_low = models.FloatField(
        null=True, help_text="repeatability on the one installation there is, from 3 sessions on"
    )
    repeat_high = models.FloatField(null=True)
    sessions = models.PositiveIntegerField()
    installations = models.PositiveIntegerField()
    ate_max = models.FloatField(
        null=True, help_text="largest ATE of the configuration among those sessions, m"
    )
    state = models.CharField(
        max_length=16, choices=State.choices, help_text="suspect: no valid session, only suspect ones"
    )
    last_session_at = models.DateTimeField()
    computed_at = models.DateTimeField(auto_now=True)

    class Meta:
        ordering = ["-speedup"]
        constraints = [
            models.UniqueConstraint(
                fields=["front", "configuration", "device", "backend", "processor"], name="device_speedup_key"
            ),
        ]

    def __str__(self) -> str:
        return f"{self.device_id} {self.configuration_id} {self.speedup:.2f}"


class DeviceActivity(models.Model):
    """How much of a device model was measured, kept so that no page has to count sessions."""

    device = models.OneToOneField(DeviceModel, on_delete=models.CASCADE, related_name="activity")
    sessions = models.PositiveIntegerField()
    installations = models.PositiveIntegerField()
    last_session_at = models.DateTimeField()

    class Meta:
        verbose_name_plural = "device activities"

    def __str__(self) -> str:
        return f"{self.device_id}: {self.sessions} sessions"


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
