"""Steps of an exploration, such as pause: when they are available and what they do. Each is audited."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from django.core.exceptions import ValidationError
from django.db import transaction

from crowd.audit.services import record
from crowd.explorations import services, tasks
from crowd.explorations.models import MAX_BUDGET, Evaluation, Exploration, ReferenceDevice
from crowd.explorations.outcomes import publishing
from crowd.explorations.preparing import preparation
from crowd.explorations.searching import search
from crowd.fronts.models import FrontVersion
from crowd.fronts.publishing import services as fronts

State = Exploration.State
MAX_QUOTED = 40  # characters of the input that an error quotes


@dataclass(frozen=True)
class Step:
    """A button: its label, the states in which it is available, its action, its name in the audit log.

    `act` gets the exploration and the text of the budget field, and returns what it did. Raises
    ValidationError.
    """

    name: str
    label: str
    states: tuple[str, ...]
    act: Callable[[Exploration, str], str]
    logged: str


def take_step(name: str, exploration: Exploration, by: str, budget: str = "") -> str:
    """Take the step `name` for the user `by`; returns what it did.

    Raises ValidationError, without a log entry.
    """
    step = STEPS[name]
    if exploration.prepares_id is not None and name not in OF_PREPARATIONS:
        raise ValidationError(f"{exploration} prepares a front: it can only be paused, resumed and cancelled")
    with transaction.atomic():
        before = Exploration.objects.select_for_update().get(pk=exploration.pk).state
        done = step.act(exploration, budget)
        log_step(exploration, by, step.logged, before, done)
    return done


def start(exploration: Exploration, by: str, known: Sequence[Mapping[str, Any]] = ()) -> Exploration:
    """Store a new `exploration` and queue its first measurements, those of `known` configurations too.

    Raises ValidationError.
    """
    with transaction.atomic():
        services.create(exploration, known)
        log_step(exploration, by, "started", "", f"{exploration}, budget {exploration.budget}")
        tasks.dispatch(exploration)
    return exploration


def prepare(front: FrontVersion, by: str, device: ReferenceDevice | None = None) -> Exploration:
    """Prepare the draft `front`; of a released one a draft of the next version. `device` as in `preparation`.

    Returns the preparation, or the one that is unfinished. Raises ValidationError if it is in review, and the
    errors of `crowd.fronts.publishing.services.create_draft`.
    """
    with transaction.atomic():
        if front.published_at is not None:
            front = fronts.draft_again(front, by)
        begun = preparation.create(front, device)
        if begun.state == State.PAUSED:
            services.resume(begun)
        log_step(begun, by, "preparation started", "", f"{begun} prepares {front.slug}")
        tasks.continue_work(begun)
    return begun


def measure_again(exploration: Exploration, keys: Iterable[str], times: int, by: str) -> list[Evaluation]:
    """Measure the points `keys` `times` more. Returns the new evaluations. Raises ValidationError."""
    with transaction.atomic():
        before = Exploration.objects.select_for_update().get(pk=exploration.pk).state
        rows = publishing.measure_again(exploration, keys, times)
        log_step(exploration, by, "measurements repeated", before, f"{len(rows)} further measurements")
        tasks.dispatch(exploration)
    return rows


def log_step(exploration: Exploration, by: str, action: str, before: str, note: str = "") -> None:
    """Log that `by` did `action` to `exploration`, which was in the state `before`."""
    subject = f"exploration {exploration.pk}"
    record(by, action, subject, note, from_state=before, to_state=exploration.state)


def available_steps(exploration: Exploration) -> list[Step]:
    """The steps that are available now: none if it was measured elsewhere."""
    if exploration.reference_device.elsewhere:
        return []
    failed = exploration.evaluations.filter(state=Evaluation.State.FAILED).exclude(phase__in=search.COPIED)
    return [
        step
        for step in STEPS.values()
        if exploration.state in step.states
        and (step.name != "retry" or failed.exists())
        and (exploration.prepares_id is None or step.name in OF_PREPARATIONS)
    ]


def parse_budget(text: str, exploration: Exploration) -> int:
    """`text` as a larger budget of `exploration`. Raises ValidationError."""
    digits = text.strip()
    short = digits.isdecimal() and len(digits) <= len(str(MAX_BUDGET))
    if not short or not exploration.budget < int(digits) <= MAX_BUDGET:
        raise ValidationError(
            f"budget {text[:MAX_QUOTED]!r}: give a whole number above {exploration.budget}, "
            f"{MAX_BUDGET} at most"
        )
    return int(digits)


def _pause(exploration: Exploration, _: str) -> str:
    services.pause(exploration)
    return "paused, no further measurement starts"


def _resume(exploration: Exploration, _: str) -> str:
    services.resume(exploration)
    tasks.continue_work(exploration)
    return "resumed"


def _cancel(exploration: Exploration, _: str) -> str:
    services.cancel(exploration)
    return "cancelled, what was measured stays"


def _raise_budget(exploration: Exploration, budget: str) -> str:
    services.raise_budget(exploration, parse_budget(budget, exploration))
    tasks.continue_work(exploration)
    return f"searches up to {exploration.budget} configurations"


def _retry(exploration: Exploration, _: str) -> str:
    count = services.retry_failures(exploration)
    tasks.continue_work(exploration)
    return f"failures to measure again: {count}"


OF_PREPARATIONS = ("pause", "resume", "cancel")
UNCANCELLED = (State.RUNNING, State.PAUSED, State.DONE)
STEPS = {
    step.name: step
    for step in (
        Step("pause", "Pause", (State.RUNNING,), _pause, "paused"),
        Step("resume", "Resume", (State.PAUSED,), _resume, "resumed"),
        Step("raise", "Raise the budget", UNCANCELLED, _raise_budget, "budget raised"),
        Step("retry", "Measure failures once more", UNCANCELLED, _retry, "failures repeated"),
        Step("cancel", "Cancel for good", (State.RUNNING, State.PAUSED), _cancel, "cancelled"),
    )
}
