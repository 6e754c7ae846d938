"""Which speedups are plausible before others confirm them. All values are natural logarithms of speedups."""

import math
from collections.abc import Hashable, Sequence

from crowd.results.validity.measures import AGREEMENT

# (low, high), log ratios
Bounds = tuple[float, float]

# Where nothing is known of a configuration.
WIDEST: Bounds = (math.log(1 / 4), math.log(64))
# How far beyond what is known a speedup may lie.
REACH_RATIO = 4.0
REACH = math.log(REACH_RATIO)


def plausible_range(
    predicted_ratio: float | None, confirmed_log_ratios_of_other_models: Sequence[float]
) -> Bounds:
    """Between which log ratios a session of one configuration is plausible: (low, high).

    PREDICTED_RATIO is the default's predicted runtime over the configuration's on the front's reference
    device; None where the front does not say. From a quarter of the smallest of 1, the prediction and what
    other models reached, to four times the largest of them. WIDEST where nothing is known.
    Raises ValueError for a predicted ratio that is not above 0.
    """
    if predicted_ratio is not None and not predicted_ratio > 0:
        raise ValueError(f"a predicted ratio of {predicted_ratio}: predicted runtimes are above 0 s")
    predicted = [] if predicted_ratio is None else [math.log(predicted_ratio)]
    known = [*predicted, *confirmed_log_ratios_of_other_models]
    if not known:
        return WIDEST
    return min(0.0, *known) - REACH, max(0.0, *known) + REACH


def corroborated(sessions: Sequence[tuple[Hashable | None, float]]) -> list[bool]:
    """Of each session (unit, log ratio), whether a session of another unit lies within AGREEMENT of it.

    The unit is the key of the network from which its installation was enrolled. None stands for an unknown
    network, whose sessions support no other.
    """
    order = sorted(range(len(sessions)), key=lambda place: sessions[place][1])
    found = [False] * len(sessions)
    for direction in (order, order[::-1]):
        nearest: dict[Hashable, float] = {}  # the nearest value of each of the last two units
        for place in direction:
            unit, value = sessions[place]
            others = [known for other, known in nearest.items() if other != unit]
            if any(abs(value - known) <= AGREEMENT for known in others):
                found[place] = True
            if unit is None:
                continue
            nearest.pop(unit, None)
            nearest[unit] = value
            if len(nearest) > 2:
                del nearest[next(iter(nearest))]
    return found
