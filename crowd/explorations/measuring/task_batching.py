"""How many evaluations share a message: to send, take and acknowledge one costs milliseconds of CPU.

A measurement of seconds or minutes has a message of its own. Where they are quicker, as many share one as
take MESSAGE_SECONDS together, and no more than leave MESSAGES_A_MACHINE for each machine of the device.
"""

from collections.abc import Sequence
from statistics import median

from crowd.explorations.models import Evaluation, Exploration

MESSAGE_SECONDS = 0.5
MESSAGES_A_MACHINE = 4
RECENT = 20  # measurements by which the next ones are judged


def messages(exploration: Exploration, evaluations: Sequence[Evaluation]) -> list[list[int]]:
    """The keys of EVALUATIONS, all of EXPLORATION, by the message that announces them, in their order."""
    size = together(len(evaluations), exploration.reference_device.machines, _seconds(exploration))
    keys = [evaluation.pk for evaluation in evaluations]
    return [keys[first : first + size] for first in range(0, len(keys), size)]


def together(waiting: int, machines: int, seconds: float | None) -> int:
    """How many of so many WAITING share a message, if one takes so many SECONDS (None: nobody knows yet)."""
    if seconds is None or seconds > MESSAGE_SECONDS:
        return 1
    most = waiting // (machines * MESSAGES_A_MACHINE)
    return max(1, min(most, int(MESSAGE_SECONDS / seconds) if seconds > 0 else most))


def _seconds(exploration: Exploration) -> float | None:
    """The median duration of the last measurements, None before the first."""
    last = exploration.evaluations.filter(state=Evaluation.State.DONE, started_at__isnull=False)
    moments = last.order_by("-number").values_list("started_at", "finished_at")[:RECENT]
    durations = [(end - begun).total_seconds() for begun, end in moments if begun and end]
    return median(durations) if durations else None
