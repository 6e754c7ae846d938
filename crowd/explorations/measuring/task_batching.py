"""Groups evaluations into messages, since each message costs milliseconds of CPU.

A measurement of seconds or minutes has its own message. Quicker ones share messages of at most
MESSAGE_SECONDS, with at least MESSAGES_A_MACHINE messages for each machine of the device.
"""

from collections.abc import Sequence
from statistics import median

from crowd.explorations.models import Evaluation, Exploration

MESSAGE_SECONDS = 0.5
MESSAGES_A_MACHINE = 4
RECENT = 20  # measurements that predict the duration of the next ones


def messages(exploration: Exploration, evaluations: Sequence[Evaluation]) -> list[list[int]]:
    """The keys of `evaluations` of `exploration` by message, in order."""
    size = batch_size(len(evaluations), exploration.reference_device.machines, _seconds(exploration))
    keys = [evaluation.pk for evaluation in evaluations]
    return [keys[first : first + size] for first in range(0, len(keys), size)]


def batch_size(waiting: int, machines: int, seconds: float | None) -> int:
    """How many of `waiting` evaluations share a message, if each takes `seconds` (None: unknown)."""
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
