"""A search for good configurations on a reference device, and each measurement that it asked for."""

from typing import Any

from django.core.exceptions import ValidationError
from django.core.validators import MaxValueValidator, MinValueValidator, RegexValidator
from django.db import models

from pareto.errors import ParetoError
from pareto.methods import DEFAULT, METHODS
from pareto.space import Space

NAME = RegexValidator(
    r"\A[a-z0-9][a-z0-9_-]*\Z", "lower-case letters, digits, - and _, starting with a letter or digit"
)


def validate_space(description: Any) -> None:
    """Raise ValidationError where DESCRIPTION is no space of pareto's."""
    try:
        Space.from_dict(description)
    except ParetoError as error:
        raise ValidationError(str(error), code="space") from error


class ReferenceDevice(models.Model):
    """A machine on which explorations measure: a Celery worker that listens on a queue of its own."""

    name = models.CharField(max_length=64, unique=True, validators=[NAME])
    queue = models.CharField(max_length=64, validators=[NAME], help_text="celery worker --queues QUEUE")
    opencl_device = models.CharField(
        max_length=200, blank=True, help_text="a part of an OpenCL device's description; empty: the best one"
    )

    class Meta:
        ordering = ["name"]

    def __str__(self) -> str:
        return self.name


class Exploration(models.Model):
    """A search over a space: what to minimise on which sequence, and how far it has come.

    `budget` configurations are searched in batches of `batch`; the application's known configurations are
    measured besides. At the end up to `points` of the front are measured `repeats` times more.
    """

    class State(models.TextChoices):
        RUNNING = "running"
        DONE = "done"
        STOPPED = "stopped"

    application = models.CharField(max_length=64, validators=[NAME], default="kfusion")
    space = models.JSONField(validators=[validate_space])
    sequence = models.CharField(max_length=200, help_text="name of a pack")
    sequence_sha256 = models.CharField(max_length=64, help_text="digest of that pack")
    reference_device = models.ForeignKey(
        ReferenceDevice, on_delete=models.PROTECT, related_name="explorations"
    )
    objectives = models.JSONField(help_text="names, all minimised: runtime, ate_max, ...")
    limits = models.JSONField(default=dict, blank=True, help_text="upper bounds by objective")
    method = models.CharField(max_length=32, default=DEFAULT, choices=[(name, name) for name in METHODS])
    seed = models.PositiveIntegerField(default=0)
    budget = models.PositiveIntegerField(validators=[MinValueValidator(1)])
    batch = models.PositiveSmallIntegerField(default=8, validators=[MinValueValidator(1)])
    points = models.PositiveSmallIntegerField(default=12, validators=[MinValueValidator(2)])
    repeats = models.PositiveSmallIntegerField(default=3, validators=[MaxValueValidator(100)])
    command = models.TextField(blank=True, help_text="the command line that created it, if one did")
    state = models.CharField(max_length=16, choices=State.choices, default=State.RUNNING)
    search = models.JSONField(default=dict, help_text="the explorer's own state")
    created_at = models.DateTimeField(auto_now_add=True)
    finished_at = models.DateTimeField(null=True, blank=True)

    class Meta:
        ordering = ["-created_at", "-id"]
        constraints = [
            models.CheckConstraint(
                condition=~models.Q(state="done") | models.Q(finished_at__isnull=False),
                name="exploration_done_has_a_date",
            ),
        ]

    def __str__(self) -> str:
        return f"{self.application} {self.pk}"


class Evaluation(models.Model):
    """One measurement of one configuration. The row is the truth; a message only says to look at it.

    Whoever measures holds a lease, renewed while it runs; `attempt` counts the leases and tells the present
    holder from an earlier one that was given up for dead.
    """

    class State(models.TextChoices):
        PENDING = "pending"
        RUNNING = "running"
        DONE = "done"
        FAILED = "failed"

    class Phase(models.TextChoices):
        GIVEN = "given", "given (a known configuration)"
        RANDOM = "random"
        ACTIVE = "active", "active (learnt)"
        REPEAT = "repeat", "repeat (against noise)"

    exploration = models.ForeignKey(Exploration, on_delete=models.CASCADE, related_name="evaluations")
    number = models.PositiveIntegerField(help_text="order within the exploration, from 0")
    phase = models.CharField(max_length=16, choices=Phase.choices)
    label = models.CharField(max_length=64, blank=True, validators=[NAME], help_text="name, if it has one")
    configuration = models.JSONField()
    configuration_key = models.CharField(max_length=64, help_text="digest of the configuration")
    state = models.CharField(max_length=16, choices=State.choices, default=State.PENDING)
    attempt = models.PositiveSmallIntegerField(default=0)
    lease_until = models.DateTimeField(null=True, blank=True)
    objectives = models.JSONField(null=True, blank=True, help_text="seconds a frame, metres")
    stages = models.JSONField(null=True, blank=True, help_text="mean seconds a frame by stage")
    device = models.JSONField(null=True, blank=True)
    software = models.CharField(max_length=64, blank=True)
    error = models.TextField(blank=True)
    created_at = models.DateTimeField(auto_now_add=True)
    finished_at = models.DateTimeField(null=True, blank=True)

    class Meta:
        ordering = ["exploration_id", "number"]
        constraints = [
            models.UniqueConstraint(fields=["exploration", "number"], name="evaluation_number"),
            models.CheckConstraint(
                condition=~models.Q(state="done") | models.Q(objectives__isnull=False),
                name="evaluation_done_has_objectives",
            ),
            models.CheckConstraint(
                condition=~models.Q(state="running") | models.Q(lease_until__isnull=False),
                name="evaluation_running_has_a_lease",
            ),
            models.CheckConstraint(
                condition=~models.Q(state="failed") | ~models.Q(error=""),
                name="evaluation_failed_has_a_reason",
            ),
        ]
        indexes = [models.Index(fields=["state", "lease_until"], name="evaluation_leases")]

    def __str__(self) -> str:
        return f"{self.exploration} #{self.number}"
