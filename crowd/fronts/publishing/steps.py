"""The steps of a front, with the states that allow them and the permissions that they need."""

from collections.abc import Callable
from dataclasses import dataclass

from crowd.fronts.models import FrontVersion
from crowd.fronts.publishing import services

State = FrontVersion.State
SUBMIT, PUBLISH = "fronts.submit_frontversion", "fronts.publish_frontversion"


@dataclass(frozen=True)
class Step:
    """A step, shown as a button: its label, states, permission, and the message afterwards.

    `notes`: a reason can be given for the log. `publishes`: the step asks for confirmation.
    """

    name: str
    label: str
    states: tuple[str, ...]
    permission: str
    take: Callable[..., FrontVersion | None]
    done: str
    notes: bool = False
    publishes: bool = False


STEPS = {
    step.name: step
    for step in (
        Step(
            *("submit", "Submit for review", (State.DRAFT,), SUBMIT, services.submit),
            "Front {} is in review: its content is fixed now",
            notes=True,
        ),
        Step(
            *("publish", "Publish", (State.IN_REVIEW,), PUBLISH, services.publish),
            "Front {} is published: clients measure it now",
            notes=True,
            publishes=True,
        ),
        Step(
            *("send-back", "Send back to draft", (State.IN_REVIEW,), SUBMIT, services.send_back),
            "Front {} is a draft again",
            notes=True,
        ),
        Step(
            *("retire", "Retire", (State.PUBLISHED,), PUBLISH, services.retire),
            "Front {} is retired: clients no longer measure it",
            notes=True,
        ),
        Step(
            *("publish-again", "Publish again as a new version", (State.PUBLISHED, State.RETIRED), PUBLISH),
            services.publish_again,
            "Front {} is {state}",
            publishes=True,
        ),
        Step(
            *("discard", "Discard this draft", (State.DRAFT,), SUBMIT, services.discard),
            "The draft is deleted; the log keeps an entry",
        ),
    )
}
