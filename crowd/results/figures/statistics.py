"""From sessions to the crowd's figure: pure functions over NumPy arrays.

The chain, each level averaged before the next so that nobody counts twice: session (mean of paired log ratios)
-> installation (mean) -> network (mean) -> device model (robust location, t interval over networks) -> crowd
(random-effects mean over models). Frames are not replicates of a run, and sessions are not replicates of an
installation: an interval over either covers the truth far too rarely.
"""

import math
from collections import Counter
from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowd.results.validity.measures import AGREEMENT, CONFIDENCE, t_quantile

# Independent networks that have to agree before a figure is confirmed; FRONTRUNNER_QUORUM sets another number.
QUORUM = 3
LEAST_UNITS = 3
LEAST_SESSIONS = 3
LEAST_MODELS = 3
SESSIONS_PER_DAY = 5
OUTLIER_DEVIATIONS = 5.0
# The median absolute deviation of normal values, times this, estimates their standard deviation.
NORMAL_MAD = 1.4826
# Installations of one model differ by a tenth without any fault, and of few the deviation may be 0 by chance.
LEAST_DEVIATION = math.log(1.1)


def ratio(log_ratio: float) -> float:
    """The speedup behind a log ratio."""
    return math.exp(log_ratio)


def geometric_mean(ratios: Sequence[float]) -> float:
    """Of one ratio or more. Never an arithmetic mean of ratios."""
    return math.exp(math.fsum(map(math.log, ratios)) / len(ratios))


@dataclass(frozen=True)
class Interval:
    """A ratio with its confidence interval; low and high are None where no interval is due."""

    value: float
    low: float | None
    high: float | None


def within_daily_limit(keys: Iterable[Hashable]) -> list[bool]:
    """Of each key, in the given order, whether it is among the first SESSIONS_PER_DAY of its kind.

    A key says whose session it is, of which day, and what for.
    """
    seen: Counter[Hashable] = Counter()
    counted = []
    for key in keys:
        seen[key] += 1
        counted.append(seen[key] <= SESSIONS_PER_DAY)
    return counted


@dataclass(frozen=True)
class InstallationValue:
    """One installation: mean and standard deviation (0 for one session) of its sessions' log ratios.

    `network`: a key of the network from which it was enrolled, None where it is unknown.
    """

    log_ratio: float
    deviation: float
    sessions: int
    network: Hashable | None = None


@dataclass(frozen=True)
class Unit:
    """What counts once: the installations of one network, or one installation without a known network."""

    log_ratio: float
    network: Hashable | None
    installations: int
    sessions: int


def units(installations: Iterable[InstallationValue]) -> list[Unit]:
    """INSTALLATIONS of one figure by network, each the mean over its installations; in order of appearance."""
    raise NotImplementedError


def location(logs: ArrayLike) -> float:
    """A robust mean of LOGS (n,), which one hostile value among few cannot pull far. ValueError for none."""
    raise NotImplementedError


@dataclass(frozen=True)
class ModelSpeedup:
    """A device model's speedup.

    `repeat`: the repeatability on the one installation there is, else None. `units`: how many values stand
    behind the figure; `networks`: how many of them come from known networks. `deviation`: standard deviation
    of the units' log ratios, None for a single one.
    """

    speedup: Interval
    repeat: Interval | None
    sessions: int
    installations: int
    units: int
    networks: int
    deviation: float | None


def model_speedup(installations: Sequence[InstallationValue]) -> ModelSpeedup:
    """The location of the units of INSTALLATIONS, with a t interval over them from LEAST_UNITS on.

    Raises ValueError for no installation.
    """
    raise NotImplementedError


def usual_range(unit_logs: ArrayLike) -> tuple[float, float] | None:
    """Between which log ratios a session is not an outlier, given UNIT_LOGS (n,); None for too few units."""
    raise NotImplementedError


def without_agreement(sessions: Sequence[tuple[Hashable, float]]) -> list[bool]:
    """Of each session (unit, log ratio), whether no session of another unit lies within AGREEMENT.

    The unit is the key of the network, or of the installation where the network is unknown.
    """
    raise NotImplementedError


def confirmed(
    networks: Sequence[Hashable | None], log_ratios: ArrayLike, own: ArrayLike, quorum: int = QUORUM
) -> bool:
    """Whether QUORUM independent networks agree with a figure, by the outlier rule.

    One entry for each installation of the pool: of the figure's own model (OWN true), and where wanted of
    other models with the same chip, backend and processor class. NETWORKS: its network's key, None where
    unknown, which counts towards the range and not towards the quorum. LOG_RATIOS (n,): its mean. The
    figure itself, the location of the own units, has to lie within the usual range of the pool, together with
    units of at least QUORUM known networks.
    """
    raise NotImplementedError


def figure_variances(units: ArrayLike, deviations: Sequence[float | None]) -> NDArray[np.float64]:
    """The variance of each figure's log ratio (n,), from the variance within models, pooled over all of them.

    UNITS (n,) and DEVIATIONS are those of each figure's `ModelSpeedup`. Three values estimate a variance
    badly; the pooled one has the degrees of freedom of all. 0 where no figure has two units.
    """
    raise NotImplementedError


def crowd_speedup(figures: Sequence[tuple[float, float]]) -> Interval | None:
    """Random-effects mean over device models of FIGURES (log ratio, variance); None for none.

    With an interval from LEAST_MODELS on.
    """
    raise NotImplementedError
