"""Explorations: searches for good configurations on a reference device, and their measurements."""

import math
from typing import Any

from django.conf import settings
from django.core.exceptions import ValidationError
from django.core.validators import MaxValueValidator, MinValueValidator
from django.db import models

from crowd.fronts.models import NAME, FrontVersion
from pareto.errors import ParetoError
from pareto.search.methods import DEFAULT, METHODS
from pareto.spaces.space import Space
from slam.devices.device import BACKENDS
from wire.protocol import FIRST_COUNTED_FRAME

MAX_BUDGET = 1_000_000


def validate_packs(value: Any) -> None:
    """Raise ValidationError if `value` is not a list of packs: objects with `name` and `sha256` only."""
    members = {"name", "sha256"}
    packs = value if isinstance(value, list) else [value]
    whole = isinstance(value, list) and all(isinstance(pack, dict) and set(pack) == members for pack in packs)
    if not whole or not all(isinstance(text, str) for pack in packs for text in pack.values()):
        raise ValidationError(f"{value!r:.80}: give a list of {{name, sha256}}", code="packs")


def validate_space(description: Any) -> None:
    """Raise ValidationError if `description` is not a valid space."""
    try:
        Space.from_dict(description)
    except ParetoError as error:
        raise ValidationError(str(error), code="space") from error


# Migrations name these functions, not what they return: a new backend or method needs no migration.
def backend_choices() -> list[tuple[str, str]]:
    """What can compute on a reference device."""
    return [(name, name) for name in BACKENDS]


def method_choices() -> list[tuple[str, str]]:
    """The methods of searching."""
    return [(name, name) for name in METHODS]


class ReferenceDevice(models.Model):
    """One or more equal machines on which explorations measure, each one configuration at a time.

    Celery workers on its own queue serve it, or clients over HTTP with its token (only the digest is stored).
    A device `elsewhere` belongs to another server, whose explorations were imported: nothing serves it here.
    """

    name = models.CharField(max_length=64, validators=[NAME])
    elsewhere = models.CharField(
        "machine elsewhere",
        max_length=200,
        blank=True,
        editable=False,
        help_text="the machine of another server that measured with it; empty: it measures for this server",
    )
    queue = models.CharField(max_length=64, validators=[NAME], help_text="celery worker --queues QUEUE")
    backend = models.CharField(
        max_length=16,
        default="opencl",
        choices=backend_choices,
        help_text="what computes",
    )
    opencl_device = models.CharField(
        "device",
        max_length=200,
        blank=True,
        help_text="a part of the description of the backend's device; empty: the best one",
    )
    machines = models.PositiveSmallIntegerField(
        default=1,
        validators=[MinValueValidator(1)],
        help_text="equal machines that serve it: no more measurements than that run at once",
    )
    token_sha256 = models.CharField(max_length=64, null=True, unique=True, editable=False)  # noqa: DJ001
    token_issued_at = models.DateTimeField(null=True, blank=True, editable=False)
    set_aside = models.TextField(
        blank=True,
        help_text="why it gets no more leases over HTTP, such as answers that contradict; empty: it does",
    )
    seen_at = models.DateTimeField(
        null=True, blank=True, editable=False, help_text="when a worker last asked for work or started"
    )

    class Meta:
        ordering = ["name"]
        constraints = [
            models.UniqueConstraint(
                fields=["name"], condition=models.Q(elsewhere=""), name="reference_device_name"
            ),
        ]

    def __str__(self) -> str:
        return f"{self.name} (measured elsewhere, on {self.elsewhere})" if self.elsewhere else self.name

    def clean(self) -> None:
        """Raises ValidationError for the queue of the server's own worker, which must not measure."""
        server_queue = settings.CELERY_TASK_DEFAULT_QUEUE
        if self.queue == server_queue:
            raise ValidationError(
                {"queue": f"{server_queue} is the queue of the server's own tasks: choose another"}
            )


class Exploration(models.Model):
    """A search over a space: its objectives, its sequences and its state.

    Errors are the worst over `sequence` and `further_sequences`, times are the mean. A measurement of the
    search ends early once it certainly exceeds the limit of `ate_max`.

    The search measures `budget` configurations in batches of `batch`, in addition to the known configurations
    of the application. At the end, up to `points` of the front are measured `repeats` more times over the
    whole sequence, even if the search uses fewer `frames`. A `synchronous` search finishes a batch before it
    proposes the next, so that it is reproducible. Otherwise it proposes more after half a batch.
    """

    class State(models.TextChoices):
        RUNNING = "running"
        PAUSED = "paused"
        DONE = "done"
        CANCELLED = "cancelled"

    application = models.CharField(max_length=64, validators=[NAME], default="kfusion")
    space = models.JSONField(validators=[validate_space])
    sequence = models.CharField(max_length=200, help_text="name of the pack that clients measure on")
    sequence_sha256 = models.CharField(max_length=64, help_text="digest of that pack")
    further_sequences = models.JSONField(
        default=list,
        blank=True,
        validators=[validate_packs],
        help_text="[{name, sha256}]: learned on besides, in this order",
    )
    held_out_sequences = models.JSONField(
        default=list,
        blank=True,
        validators=[validate_packs],
        help_text="[{name, sha256}]: never learned on; the points found are checked on them",
    )
    error_quantile = models.FloatField(
        default=1.0,
        validators=[MinValueValidator(0.01), MaxValueValidator(1.0)],
        help_text="of the errors on the sequences learned on, which one counts: 1 is the worst",
    )
    reference_device = models.ForeignKey(
        ReferenceDevice,
        on_delete=models.PROTECT,
        related_name="explorations",
        limit_choices_to={"elsewhere": ""},
    )
    objectives = models.JSONField(help_text="names, all minimised: runtime_ratio, ate_max, ...")
    limits = models.JSONField(default=dict, blank=True, help_text="upper bounds by objective")
    method = models.CharField(max_length=32, default=DEFAULT, choices=method_choices)
    options = models.JSONField(default=dict, blank=True, help_text="the method's own, such as initial: 200")
    seed = models.PositiveIntegerField(default=0)
    frames = models.PositiveIntegerField(
        null=True,
        blank=True,
        validators=[MinValueValidator(FIRST_COUNTED_FRAME + 1)],
        help_text="frames that a measurement of the search runs; empty: all of the sequence",
    )
    synchronous = models.BooleanField(
        default=True, help_text="measure a whole batch before the next is asked"
    )
    recheck = models.BooleanField(
        default=True, help_text="measure again what lies far from what its neighbours lead to expect"
    )
    budget = models.PositiveIntegerField(validators=[MinValueValidator(1), MaxValueValidator(MAX_BUDGET)])
    batch = models.PositiveSmallIntegerField(default=8, validators=[MinValueValidator(1)])
    points = models.PositiveSmallIntegerField(default=12, validators=[MinValueValidator(2)])
    repeats = models.PositiveSmallIntegerField(default=3, validators=[MaxValueValidator(100)])
    command = models.TextField(blank=True, help_text="the command line that created it, if one did")
    state = models.CharField(max_length=16, choices=State.choices, default=State.RUNNING)
    note = models.TextField(
        blank=True, help_text="why it was paused by itself, or why a machine could not measure for it"
    )
    prepares = models.ForeignKey(
        FrontVersion,
        on_delete=models.CASCADE,
        null=True,
        blank=True,
        related_name="preparations",
        help_text="the front whose points it measures for clients; it searches nothing",
    )
    prepares_digest = models.CharField(
        max_length=64, blank=True, help_text="of the draft when its preparation began"
    )
    sha256 = models.CharField(
        max_length=64,
        blank=True,
        db_index=True,
        editable=False,
        help_text="digest of its content when it was imported, or when a front was last made of it",
    )
    warm_start_from = models.ForeignKey(
        "self",
        on_delete=models.SET_NULL,
        null=True,
        blank=True,
        related_name="warm_starts",
        help_text="an earlier exploration whose measurements are told as known",
    )
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

    @property
    def measures_program(self) -> bool:
        """Whether it only leases the configurations of `frontrunner tune`, for a program of its user."""
        return not self.sequence

    @property
    def learned_on(self) -> list[dict[str, str]]:
        """Name and digest of each pack that it learns on, that of clients first; none for a program."""
        if self.measures_program:
            return []
        return [{"name": self.sequence, "sha256": self.sequence_sha256}, *self.further_sequences]

    @property
    def failures_allowed(self) -> int:
        """The number of sequences whose error may be larger than the one at `error_quantile`."""
        count = len(self.learned_on)
        return count - max(math.ceil(self.error_quantile * count), 1)


class Evaluation(models.Model):
    """One measurement of one configuration. Messages only contain its key.

    The worker holds a lease and renews it during the measurement. `attempt` counts the leases, which
    distinguishes the current worker from earlier, lost ones.
    """

    class State(models.TextChoices):
        PENDING = "pending"
        RUNNING = "running"
        DONE = "done"
        FAILED = "failed"

    class Phase(models.TextChoices):
        GIVEN = "given", "given (a known configuration)"
        DEFAULT = "default", "default (to compare a round with)"
        RANDOM = "random"
        ACTIVE = "active", "active (learnt)"
        AGAIN = "again", "again (the search wants to know it better)"
        CHECK = "check", "check (of an outlier)"
        REPEAT = "repeat", "repeat (against noise)"
        KNOWN = "known", "known (from an earlier exploration)"
        PRIOR = "prior", "prior (from another device or sequence)"
        REFERENCE = "reference", "reference (on every device of a machine, for clients)"
        TIME = "time", "time (beside the default on the clients' sequence)"

    exploration = models.ForeignKey(
        Exploration,
        on_delete=models.CASCADE,
        related_name="evaluations",
        db_index=False,  # the unique number's index begins with it
    )
    number = models.PositiveIntegerField(help_text="order within the exploration, from 0")
    phase = models.CharField(max_length=16, choices=Phase.choices)
    label = models.CharField(max_length=64, blank=True, validators=[NAME], help_text="name, if it has one")
    configuration = models.JSONField()
    configuration_key = models.CharField(max_length=64, help_text="digest of the configuration")
    index = models.BigIntegerField(null=True, help_text="of the configuration in its space, if it is there")
    iteration = models.PositiveIntegerField(default=0, help_text="which time it was asked for more, from 1")
    frames = models.PositiveIntegerField(null=True, blank=True, help_text="to run; empty: the whole sequence")
    copied_from = models.ForeignKey(
        "self", on_delete=models.SET_NULL, null=True, blank=True, related_name="copies"
    )
    state = models.CharField(max_length=16, choices=State.choices, default=State.PENDING)
    attempt = models.PositiveIntegerField(default=0, help_text="leases so far; never goes back")
    losses = models.PositiveSmallIntegerField(default=0, help_text="leases that ran out")
    worker = models.CharField(max_length=200, blank=True, help_text="who measures or measured it")
    started_at = models.DateTimeField(null=True, blank=True)
    heartbeat_at = models.DateTimeField(null=True, blank=True)
    lease_until = models.DateTimeField(null=True, blank=True)
    perturbation = models.PositiveSmallIntegerField(
        default=0, help_text="seed by which depth is changed by a unit; 0: it is not"
    )
    objectives = models.JSONField(null=True, blank=True, help_text="seconds a frame, metres")
    parts = models.JSONField(
        null=True, blank=True, help_text="the objectives of each sequence that was run, and its lost frames"
    )
    stop_above = models.JSONField(
        default=list,
        blank=True,
        help_text="it may end early once it is above all values of one of these: metres, seconds a frame",
    )
    censored = models.JSONField(
        default=list, blank=True, help_text="names of objectives that are at least so large: it ended early"
    )
    ratio_filled_at = models.DateTimeField(
        null=True, blank=True, editable=False, help_text="when runtime_ratio was added to the objectives"
    )
    stages = models.JSONField(null=True, blank=True, help_text="mean seconds a frame by stage")
    device = models.JSONField(null=True, blank=True)
    reference = models.JSONField(
        null=True, blank=True, help_text="trajectory (m), band (m), variants that ran, digest of the program"
    )
    software = models.CharField(max_length=64, blank=True)
    error = models.TextField(blank=True)
    created_at = models.DateTimeField(auto_now_add=True)
    finished_at = models.DateTimeField(null=True, blank=True)

    class Meta:
        ordering = ["exploration_id", "number"]
        constraints = [
            models.UniqueConstraint(fields=["exploration", "number"], name="evaluation_number"),
            models.UniqueConstraint(
                fields=["exploration", "index"],
                condition=models.Q(phase__in=["random", "active"]),
                name="evaluation_searched_once",
            ),
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
        indexes = [
            models.Index(fields=["state", "lease_until"], name="evaluation_leases"),
            models.Index(fields=["exploration", "state"], name="evaluation_states"),
        ]

    def __str__(self) -> str:
        return f"{self.exploration} #{self.number}"

    @property
    def public_phase(self) -> str:
        """The phase, empty until it is finished: its device must not know that it is measured as a check."""
        return self.phase if self.state in (self.State.DONE, self.State.FAILED) else ""
