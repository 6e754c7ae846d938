"""Which speedups are plausible before other networks confirm them, and which are possible at all, as natural
logarithms.
"""

import math
from collections.abc import Hashable, Sequence

from crowd.results.validity.measures import AGREEMENT
from slam.kfusion.work import StageRanges

# (low, high), log ratios
Bounds = tuple[float, float]

# For a configuration without any known speedup.
WIDEST_BOUNDS: Bounds = (math.log(1 / 4), math.log(64))
# How far a speedup may be from the known ones.
REACH_RATIO = 4.0
LOG_REACH = math.log(REACH_RATIO)
# How far confirmation lifts a speedup beyond the reach of the prediction, where no plan bounds it.
LOG_LIFT = math.log(2)
# Shares of stages that confirmed models showed are widened less than those of the reference device.
CONFIRMED_MARGIN = 2.0


def plausible_range(
    predicted_ratio: float | None, confirmed_log_ratios_of_other_models: Sequence[float]
) -> Bounds:
    """The plausible log ratios (low, high) of a session's configuration.

    `predicted_ratio`: predicted runtime of the default over that of the configuration on the front's
    reference device; None if the front has no prediction. The bounds are a quarter of the smallest and four
    times the largest of: 1, the prediction, the ratios of other models. WIDEST_BOUNDS without a known ratio.
    Raises ValueError for a predicted ratio that is not above 0.
    """
    if predicted_ratio is not None and not predicted_ratio > 0:
        raise ValueError(f"a predicted ratio of {predicted_ratio}: predicted runtimes are above 0 s")
    predicted = [] if predicted_ratio is None else [math.log(predicted_ratio)]
    log_ratios = [*predicted, *confirmed_log_ratios_of_other_models]
    if not log_ratios:
        return WIDEST_BOUNDS
    return min(0.0, *log_ratios) - LOG_REACH, max(0.0, *log_ratios) + LOG_REACH


def hull(one: StageRanges, other: StageRanges) -> StageRanges:
    """The ranges that contain those of `one` and of `other`, for the stages of `one`."""
    return {
        stage: (min(low, other.get(stage, (low, high))[0]), max(high, other.get(stage, (low, high))[1]))
        for stage, (low, high) in one.items()
    }


def corroborated(sessions: Sequence[tuple[Hashable | None, float]]) -> list[bool]:
    """Whether each session (unit, log ratio) is within AGREEMENT of a session of another unit.

    The unit is the key of the network from which the installation enrolled. None is an unknown network, whose
    sessions do not support others.
    """
    order = sorted(range(len(sessions)), key=lambda index: sessions[index][1])
    agreeing = [False] * len(sessions)
    for direction in (order, order[::-1]):
        nearest: dict[Hashable, float] = {}  # the nearest value of each of the last two units
        for index in direction:
            unit, value = sessions[index]
            others = [log for other, log in nearest.items() if other != unit]
            if any(abs(value - log) <= AGREEMENT for log in others):
                agreeing[index] = True
            if unit is None:
                continue
            nearest.pop(unit, None)
            nearest[unit] = value
            if len(nearest) > 2:
                del nearest[next(iter(nearest))]
    return agreeing
