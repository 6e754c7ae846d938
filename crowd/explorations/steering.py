"""Steps of an exploration: which ones its state allows, and what each does. Each is in the audit log."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from django.core.exceptions import ValidationError
from django.db import transaction

from crowd.audit.services import record
from crowd.explorations import services, tasks
from crowd.explorations.models import MOST_BUDGET, Evaluation, Exploration
from crowd.explorations.outcomes import publishing
from crowd.explorations.searching import search

State = Exploration.State
LONGEST = 40  # characters of what was typed that a refusal repeats


@dataclass(frozen=True)
class Step:
    """One button: its label, the states it is offered in, what it does, its name in the audit log.

    `act` gets the exploration and the text of the budget's field, and returns what it did. Raises
    ValidationError.
    """

    name: str
    label: str
    states: tuple[str, ...]
    act: Callable[[Exploration, str], str]
    logged: str


def take(name: str, exploration: Exploration, by: str, budget: str = "") -> str:
    """Take the step NAME in the name of BY; what it did. Raises ValidationError, and then logs nothing."""
    step = STEPS[name]
    with transaction.atomic():
        before = Exploration.objects.select_for_update().get(pk=exploration.pk).state
        done = step.act(exploration, budget)
        log(exploration, by, step.logged, before, done)
    return done


def start(exploration: Exploration, by: str) -> Exploration:
    """Store a new EXPLORATION and announce its first measurements. Raises ValidationError."""
    with transaction.atomic():
        services.create(exploration)
        log(exploration, by, "started", "", f"{exploration}, budget {exploration.budget}")
        tasks.dispatch(exploration)
    return exploration


def measure_again(exploration: Exploration, keys: Iterable[str], times: int, by: str) -> list[Evaluation]:
    """Measure the points with these KEYS TIMES more; the new evaluations. Raises ValidationError."""
    with transaction.atomic():
        before = Exploration.objects.select_for_update().get(pk=exploration.pk).state
        rows = publishing.measure_again(exploration, keys, times)
        log(exploration, by, "measurements repeated", before, f"{len(rows)} further measurements")
        tasks.dispatch(exploration)
    return rows


def log(exploration: Exploration, by: str, action: str, before: str, note: str = "") -> None:
    """Log that BY did ACTION to EXPLORATION, which was in the state BEFORE."""
    subject = f"exploration {exploration.pk}"
    record(by, action, subject, note, from_state=before, to_state=exploration.state)


def offered(exploration: Exploration) -> list[Step]:
    """The steps that make sense now."""
    failed = exploration.evaluations.filter(state=Evaluation.State.FAILED).exclude(phase__in=search.COPIED)
    return [
        step
        for step in STEPS.values()
        if exploration.state in step.states and (step.name != "retry" or failed.exists())
    ]


def budget_of(text: str, exploration: Exploration) -> int:
    """TEXT as a larger budget of EXPLORATION. Raises ValidationError."""
    digits = text.strip()
    short = digits.isdecimal() and len(digits) <= len(str(MOST_BUDGET))
    if not short or not exploration.budget < int(digits) <= MOST_BUDGET:
        raise ValidationError(
            f"budget {text[:LONGEST]!r}: give a whole number above {exploration.budget}, "
            f"{MOST_BUDGET} at most"
        )
    return int(digits)


def _pause(exploration: Exploration, _: str) -> str:
    services.pause(exploration)
    return "paused, no further measurement starts"


def _resume(exploration: Exploration, _: str) -> str:
    services.resume(exploration)
    tasks.go_on(exploration)
    return "resumed"


def _cancel(exploration: Exploration, _: str) -> str:
    services.cancel(exploration)
    return "cancelled, what was measured stays"


def _raise_budget(exploration: Exploration, budget: str) -> str:
    services.raise_budget(exploration, budget_of(budget, exploration))
    tasks.go_on(exploration)
    return f"searches up to {exploration.budget} configurations"


def _retry(exploration: Exploration, _: str) -> str:
    count = services.retry_failures(exploration)
    tasks.go_on(exploration)
    return f"failures that are measured once more: {count}"


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
