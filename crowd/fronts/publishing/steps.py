"""Steps of a front: which ones its state allows, and which permission each needs."""

from collections.abc import Callable
from dataclasses import dataclass

from crowd.fronts.models import FrontVersion
from crowd.fronts.publishing import services

State = FrontVersion.State
SUBMIT, PUBLISH = "fronts.submit_frontversion", "fronts.publish_frontversion"


@dataclass(frozen=True)
class Step:
    """One button: its label, the states it is offered in, its permission, and the message afterwards.

    With `notes` a reason can be given for the log. A step that `publishes` asks for a confirmation first.
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
            "Front {} is retired: clients measure it no longer",
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
            "The draft is gone; the log keeps an entry of it",
        ),
    )
}
