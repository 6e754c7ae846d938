"""Data that tasks derive from measurements: all of it can be deleted and computed again."""

from django.db import models

from crowd.devices.models import DeviceModel, Installation, ProcessorClass
from crowd.fronts.models import Configuration, FrontVersion
from crowd.results.models.measured import MeasurementSession, State
from wire.session_statistics import PROCESSOR, WALL


class Cohort(models.Model):
    """Sessions that may be averaged: of one device model, front, backend, chip that computed and class of it.

    Code that writes summaries of its sessions, or its figures, must hold a lock on its row.
    """

    device = models.ForeignKey(DeviceModel, on_delete=models.CASCADE, related_name="cohorts")
    front = models.ForeignKey(FrontVersion, on_delete=models.CASCADE, related_name="cohorts")
    backend = models.CharField(max_length=32)
    processor = models.CharField(max_length=200, blank=True, help_text="the chip that computed")
    processor_class = models.CharField(max_length=3, choices=ProcessorClass.choices, default="gpu")
    stale = models.BooleanField(default=False, help_text="its figures do not know its newest sessions yet")

    class Meta:
        constraints = [
            models.UniqueConstraint(
                fields=["device", "front", "backend", "processor", "processor_class"], name="cohort_key"
            ),
        ]
        indexes = [
            models.Index(fields=["id"], name="cohort_stale", condition=models.Q(stale=True)),
        ]

    def __str__(self) -> str:
        return f"{self.device_id} {self.front_id} {self.backend} {self.processor}"


class SessionSummary(models.Model):
    """A session's result for one configuration: the mean of its paired log ratios over the baseline."""

    # Indexes of several columns begin with the cohort, and with the session.
    cohort = models.ForeignKey(Cohort, on_delete=models.CASCADE, related_name="summaries", db_index=False)
    installation = models.ForeignKey(Installation, on_delete=models.CASCADE, related_name="+")
    session = models.ForeignKey(
        MeasurementSession, on_delete=models.CASCADE, related_name="summaries", db_index=False
    )
    configuration = models.ForeignKey(Configuration, on_delete=models.CASCADE, related_name="+")
    baseline = models.ForeignKey(Configuration, on_delete=models.CASCADE, related_name="+")
    algorithm = models.PositiveSmallIntegerField()
    log_ratio = models.FloatField(
        null=True, help_text="natural logarithm of the speedup; empty where no pair is valid"
    )
    low = models.FloatField(null=True, help_text="95 % interval of log_ratio over this session's pairs")
    high = models.FloatField(null=True)
    clock = models.CharField(
        max_length=9,
        choices=[(WALL, "wall"), (PROCESSOR, "processor")],
        default=WALL,
        help_text="whose times are compared: processor where other programs disturbed it",
    )
    pairs = models.PositiveSmallIntegerField()
    runs = models.PositiveSmallIntegerField(default=0, help_text="of the configuration, whatever their state")
    failed = models.PositiveSmallIntegerField(default=0, help_text="of these, how many did not finish")
    lost = models.PositiveSmallIntegerField(default=0, help_text="of these, how many lost the camera")
    drift = models.FloatField(
        null=True,
        help_text="ratio of the later repeats over the earlier ones: the farthest from 1",
    )
    ate_max = models.FloatField(null=True, help_text="largest ATE of the configuration's runs, m")
    state = models.CharField(max_length=16, choices=State.choices)
    reason = models.CharField(max_length=64, blank=True, help_text="code of the rule that set the state")
    started_at = models.DateTimeField(help_text="the session's")
    day = models.DateField(help_text="when the server received the session, UTC")
    counted = models.BooleanField(
        help_text="among the first sessions of its installation and day that have its state"
    )

    class Meta:
        verbose_name_plural = "session summaries"
        indexes = [
            models.Index(fields=["cohort", "installation", "day"], name="summary_day"),
            models.Index(fields=["cohort", "configuration", "log_ratio"], name="summary_log_ratio"),
            models.Index(fields=["cohort", "configuration", "state", "session"], name="summary_newest"),
            # A covering index for the figures of a period. It needs the column of its condition, too.
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
            models.Index(fields=["session"], name="summary_not_valid", condition=~models.Q(state="valid")),
        ]
        constraints = [
            models.UniqueConstraint(fields=["session", "configuration"], name="session_summary_key"),
        ]

    def __str__(self) -> str:
        return f"{self.session_id} {self.configuration_id}"


class DeviceSpeedup(models.Model):
    """The published figure: the speedup of a configuration over the baseline on a device model."""

    device = models.ForeignKey(DeviceModel, on_delete=models.CASCADE, related_name="speedups")
    front = models.ForeignKey(FrontVersion, on_delete=models.CASCADE, related_name="speedups")
    configuration = models.ForeignKey(Configuration, on_delete=models.CASCADE, related_name="speedups")
    baseline = models.ForeignKey(Configuration, on_delete=models.CASCADE, related_name="+")
    backend = models.CharField(max_length=32)
    processor = models.CharField(max_length=200, blank=True)
    processor_class = models.CharField(max_length=3, choices=ProcessorClass.choices, default="gpu")
    algorithm = models.PositiveSmallIntegerField()
    speedup = models.FloatField()
    low = models.FloatField(null=True, help_text="95 % interval over units, from 3 of them on")
    high = models.FloatField(null=True)
    session_low = models.FloatField(
        null=True, help_text="95 % interval of the one session behind the figure, over its pairs"
    )
    session_high = models.FloatField(null=True)
    deviation = models.FloatField(
        null=True, help_text="standard deviation of the units' log ratios; empty for one unit"
    )
    units = models.PositiveIntegerField(
        default=1, help_text="installations, those of one network counted once"
    )
    unit_logs = models.BinaryField(
        default=bytes, editable=False, help_text="key of the network and log ratio of each unit"
    )
    witnesses = models.PositiveIntegerField(
        default=0, help_text="independent networks that agree with it, on this model"
    )
    chip_witnesses = models.PositiveIntegerField(
        default=0, help_text="the same on all models with its chip, where this model alone has too few"
    )
    unsettled = models.BooleanField(
        default=True, editable=False, help_text="other models with its chip were not asked since it changed"
    )
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
                fields=["front", "configuration", "device", "backend", "processor", "processor_class"],
                name="device_speedup_key",
            ),
        ]
        indexes = [
            models.Index(fields=["id"], name="speedup_unsettled", condition=models.Q(unsettled=True)),
            models.Index(fields=["configuration", "witnesses", "speedup"], name="speedup_witnessed"),
            models.Index(fields=["configuration", "processor"], name="speedup_chip"),
        ]

    def __str__(self) -> str:
        return f"{self.device_id} {self.configuration_id} {self.speedup:.2f}"


class Outcome(models.Model):
    """How often a configuration failed or lost the camera in a cohort."""

    cohort = models.ForeignKey(Cohort, on_delete=models.CASCADE, related_name="outcomes")
    configuration = models.ForeignKey(Configuration, on_delete=models.CASCADE, related_name="+")
    sessions = models.PositiveIntegerField(help_text="that ran it")
    failed = models.PositiveIntegerField(help_text="of these, in how many a run did not finish")
    lost = models.PositiveIntegerField(help_text="of these, in how many a run lost the camera")
    networks = models.PositiveIntegerField(help_text="known networks that these come from")
    networks_failed = models.PositiveIntegerField(help_text="of these, in how many a run did not finish")
    networks_lost = models.PositiveIntegerField(help_text="of these, in how many a run lost the camera")

    class Meta:
        constraints = [
            models.UniqueConstraint(fields=["cohort", "configuration"], name="outcome_key"),
        ]

    def __str__(self) -> str:
        return f"{self.cohort_id} {self.configuration_id}: {self.failed} failed, {self.lost} lost"


class DeviceActivity(models.Model):
    """The counts of sessions and installations of a device model, stored so that pages need not count."""

    device = models.OneToOneField(DeviceModel, on_delete=models.CASCADE, related_name="activity")
    sessions = models.PositiveIntegerField()
    installations = models.PositiveIntegerField()
    last_session_at = models.DateTimeField()

    class Meta:
        verbose_name_plural = "device activities"

    def __str__(self) -> str:
        return f"{self.device_id}: {self.sessions} sessions"
