"""Which speedups are plausible before others confirm them. All values are natural logarithms of speedups."""

import math
from collections.abc import Hashable, Sequence

# Bounds where nothing is known of a configuration.
LOWEST, HIGHEST = math.log(1 / 4), math.log(64)
# How far beyond what is known a speedup may lie.
REACH = math.log(2)

# (low, high), log ratios
Bounds = tuple[float, float]


def plausible_range(
    predicted_ratio: float | None, confirmed_log_ratios_of_other_models: Sequence[float]
) -> Bounds:
    """Between which log ratios a session of one configuration is plausible: (low, high).

    PREDICTED_RATIO is the default's predicted runtime over the configuration's on the front's reference
    device; None where the front does not say. From half of the smallest of 1, the prediction and what other
    models reached, to twice the largest of them. LOWEST and HIGHEST where nothing is known.
    """
    raise NotImplementedError


def corroborated(sessions: Sequence[tuple[Hashable | None, float]]) -> list[bool]:
    """Of each session (network, log ratio), whether one from another known network lies within AGREEMENT.

    A session whose network is unknown (None) supports no other.
    """
    raise NotImplementedError
