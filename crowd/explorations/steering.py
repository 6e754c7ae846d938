"""What a person may do with an exploration: which steps its state allows, and what each then says."""

from collections.abc import Callable
from dataclasses import dataclass

from django.core.exceptions import ValidationError

from crowd.explorations import search, services, tasks
from crowd.explorations.models import MOST_BUDGET, Evaluation, Exploration

State = Exploration.State
LONGEST = 40  # characters of what was typed that a refusal repeats


@dataclass(frozen=True)
class Step:
    """One button: what it is called, in which states it is offered, what it does and says.

    `take` gets the exploration and the text of the budget's field. Raises ValidationError.
    """

    name: str
    label: str
    states: tuple[str, ...]
    take: Callable[[Exploration, str], str]


def offered(exploration: Exploration) -> list[Step]:
    """The steps that make sense now."""
    failed = exploration.evaluations.filter(state=Evaluation.State.FAILED).exclude(phase__in=search.COPIED)
    return [
        step
        for step in STEPS.values()
        if exploration.state in step.states and (step.name != "retry" or failed.exists())
    ]


def budget_of(text: str, exploration: Exploration) -> int:
    """The larger budget that TEXT is. Raises ValidationError where it is none."""
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
    return "paused, nothing more is begun"


def _resume(exploration: Exploration, _: str) -> str:
    services.resume(exploration)
    tasks.go_on(exploration)
    return "goes on"


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


STEPS = {
    step.name: step
    for step in (
        Step("pause", "Pause", (State.RUNNING,), _pause),
        Step("resume", "Resume", (State.PAUSED,), _resume),
        Step("raise", "Raise the budget", (State.RUNNING, State.PAUSED, State.DONE), _raise_budget),
        Step("retry", "Measure failures once more", (State.RUNNING, State.PAUSED, State.DONE), _retry),
        Step("cancel", "Cancel for good", (State.RUNNING, State.PAUSED), _cancel),
    )
}
