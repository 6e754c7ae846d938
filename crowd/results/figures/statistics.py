"""The statistics from sessions to the crowd's figure: pure functions over NumPy arrays.

Each level is averaged before the next, so that each participant counts once: session (mean of paired log
ratios) -> installation (mean) -> network (mean) -> device model (robust mean, t interval over networks) ->
crowd (mean over models). Frames are not replicates of a run, sessions are not replicates of an
installation: an interval over them would be far too narrow.
"""

import math
from collections import Counter
from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass
from statistics import median

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowd.records.uncertainty import (
    LEAST_DEVIATION,
    LEAST_UNITS,
    TYPICAL_DEVIATION,
    Estimate,
    figure_estimate,
)
from crowd.results.validity.measures import AGREEMENT, CONFIDENCE, OUTLIER_DEVIATIONS
from crowd.results.validity.plausibility import corroborated

LEAST_SESSIONS = 3
LEAST_MODELS = 3
# A smaller sample of models misses a tenth of all models in more than one of 20 cases: 0.9^29 = 0.047.
LEAST_SAMPLE = 29
# A model that is farther from all others is not of their kind. Of skewed crowds, one in 300 has such a model.
FAR_APART = math.log(10)
SESSIONS_PER_DAY = 5
# The median absolute deviation of normal values, times this, estimates their standard deviation.
NORMAL_MAD = 1.4826
# Huber's limit in standard deviations: values farther from the centre count as if they were at the limit.
# For normal values, the efficiency is 95 % of the mean's.
HUBER = 1.345
# Limits of the iterations, for six digits of a ratio.
HUBER_STEPS, CONVERGED = 30, 1e-9
TINY = 1e-12
LEAST_SKEWNESS = 1e-6


def ratio(log_ratio: float) -> float:
    """The speedup of `log_ratio`."""
    return math.exp(log_ratio)


def geometric_mean(ratios: Sequence[float]) -> float:
    """The geometric mean of one or more `ratios`, which are never averaged arithmetically."""
    return math.exp(math.fsum(map(math.log, ratios)) / len(ratios))


def geometric_median(ratios: Sequence[float], weights: Sequence[float] | None = None) -> float:
    """The median of one or more `ratios`; of an even number the geometric mean of the middle two. With
    unequal `weights` it is the smallest up to which half of them lies.
    """
    logs = list(map(math.log, ratios))
    if weights is None or min(weights) == max(weights):
        return math.exp(median(logs))
    return math.exp(float(weighted_median(logs, weights)))


@dataclass(frozen=True)
class Interval:
    """A ratio with its confidence interval; low and high are None for too few values."""

    value: float
    low: float | None
    high: float | None


def t_quantile(degrees: float, alpha: float) -> float:
    """The two-sided quantile of Student's t with `alpha` outside."""
    # scipy.stats takes a second to import, and the web process does not use it otherwise.
    from scipy.special import stdtrit

    return float(stdtrit(degrees, 1 - alpha / 2))


def _interval(centre: float, error: float, degrees: float) -> Interval:
    """exp(`centre`) with its two-sided t interval; `error` is the standard error of `centre`."""
    half = t_quantile(degrees, 1 - CONFIDENCE) * error
    return Interval(math.exp(centre), math.exp(centre - half), math.exp(centre + half))


def within_daily_limit(keys: Iterable[Hashable]) -> list[bool]:
    """Whether each key is among the first SESSIONS_PER_DAY equal ones, in the given order.

    A key contains the session's installation, day by the server's clock, configuration and state.
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

    `network`: a key of the network from which it enrolled, None if unknown.
    """

    log_ratio: float
    deviation: float
    sessions: int
    network: Hashable | None = None


@dataclass(frozen=True)
class Unit:
    """What counts once: the installations of one network, or an installation of unknown network."""

    log_ratio: float
    network: Hashable | None
    installations: int
    sessions: int


def units(installations: Iterable[InstallationValue]) -> list[Unit]:
    """Group `installations` of one figure by network, with the mean of each group.

    An installation of unknown network is its own unit. Known networks come first.
    """
    by_network: dict[Hashable, list[InstallationValue]] = {}
    unknown = []
    for each in installations:
        if each.network is None:
            unknown.append([each])
        else:
            by_network.setdefault(each.network, []).append(each)
    return [
        Unit(
            log_ratio=math.fsum(each.log_ratio for each in members) / len(members),
            network=members[0].network,
            installations=len(members),
            sessions=sum(each.sessions for each in members),
        )
        for members in [*by_network.values(), *unknown]
    ]


def robust_mean(unit_logs: ArrayLike, votes: ArrayLike | None = None) -> NDArray[np.float64]:
    """Huber's robust mean over the last axis of `unit_logs` (..., n): (...). Raises ValueError without
    values.

    `votes` (n,): how much each counts; without them, all count alike.

    The scale is the median absolute deviation (Huber 1964), limited so that a value beyond AGREEMENT has no
    more influence than one at it. One value of four cannot move the result far, nor two of five; a
    Hodges-Lehmann estimate would follow those two.
    """
    values = np.asarray(unit_logs, dtype=np.float64)
    if values.shape[-1] == 0:
        raise ValueError("a robust mean of no values: give at least one")
    if values.shape[-1] < LEAST_UNITS:
        weights = None if votes is None else np.asarray(votes, dtype=np.float64)
        return np.asarray(np.average(values, axis=-1, weights=weights))
    if votes is None:
        deviation, centre = robust_deviation(values), np.median(values, axis=-1, keepdims=True)
    else:
        centre = weighted_median(values, votes)[..., None]
        deviation = NORMAL_MAD * weighted_median(np.abs(values - centre), votes)
    limit = HUBER * np.clip(deviation, LEAST_DEVIATION, AGREEMENT / HUBER)
    return _huber_mean(values, limit[..., None], np.ones(1) if votes is None else np.asarray(votes), centre)


def weighted_median(values: ArrayLike, votes: ArrayLike) -> NDArray[np.float64]:
    """The smallest of `values` (..., n) up to which half of `votes` (n,) lies: (...)."""
    numbers = np.asarray(values, dtype=np.float64)
    order = np.argsort(numbers, axis=-1)
    reached = np.cumsum(np.asarray(votes, dtype=np.float64)[order], axis=-1)
    middle = np.argmax(reached >= reached[..., -1:] / 2, axis=-1)[..., None]
    medians: NDArray[np.float64] = np.take_along_axis(np.take_along_axis(numbers, order, -1), middle, -1)[
        ..., 0
    ]
    return medians


def robust_deviation(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """The standard deviation over the last axis of `values` (..., n), by the median absolute deviation."""
    median = np.median(values, axis=-1, keepdims=True)
    deviations: NDArray[np.float64] = NORMAL_MAD * np.median(np.abs(values - median), axis=-1)
    return deviations


def _huber_mean(
    values: NDArray[np.float64],
    limit: NDArray[np.float64],
    votes: NDArray[np.float64],
    centre: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Huber's mean over the last axis of `values`, iteratively reweighted from `centre`.

    Values farther than `limit` from the mean count as if at the limit, all of them `votes` times.
    """
    for _ in range(HUBER_STEPS):
        kept = votes * np.minimum(1.0, limit / np.maximum(np.abs(values - centre), TINY))
        following = (kept * values).sum(axis=-1, keepdims=True) / kept.sum(axis=-1, keepdims=True)
        step, centre = float(np.abs(following - centre).max()), following
        if step < CONVERGED:
            break
    return centre[..., 0]


@dataclass(frozen=True)
class ModelSpeedup:
    """A device model's speedup.

    `repeat`: the repeatability on the only installation, None for several. `units`: the number of values that
    are averaged; `networks`: how many of them are known networks. `deviation`: standard deviation of the
    units' log ratios, None for a single one.
    """

    speedup: Interval
    repeat: Interval | None
    sessions: int
    installations: int
    units: int
    networks: int
    deviation: float | None


def model_speedup(installations: Sequence[InstallationValue]) -> ModelSpeedup:
    """The robust mean of the units of `installations`, with a t interval from LEAST_UNITS on.

    Raises ValueError for no installation.
    """
    repeat = None
    if len(installations) == 1 and installations[0].sessions >= LEAST_SESSIONS:
        only = installations[0]
        repeat = _interval(only.log_ratio, only.deviation / math.sqrt(only.sessions), only.sessions - 1)
    groups = units(installations)
    logs = np.array([unit.log_ratio for unit in groups])
    deviation = float(logs.std(ddof=1)) if len(groups) > 1 else None
    figure = figure_estimate(float(robust_mean(logs)), deviation, len(groups))
    return ModelSpeedup(
        speedup=interval_of(figure),
        repeat=repeat,
        sessions=sum(unit.sessions for unit in groups),
        installations=len(installations),
        units=len(groups),
        networks=sum(unit.network is not None for unit in groups),
        deviation=deviation,
    )


def model_estimate(installations: Sequence[InstallationValue]) -> Estimate:
    """The mean of a model's logarithms from `installations`. Raises ValueError for no installation."""
    model = model_speedup(installations)
    return figure_estimate(math.log(model.speedup.value), model.deviation, model.units)


def usual_range(unit_logs: ArrayLike) -> tuple[float, float] | None:
    """The range of log ratios in which a session is not an outlier, given `unit_logs` (n,) of its model.

    OUTLIER_DEVIATIONS robust standard deviations around the median (Leys et al. 2013), which outliers hardly
    influence. None for fewer than LEAST_UNITS units.
    """
    values = np.asarray(unit_logs, dtype=np.float64)
    if values.size < LEAST_UNITS:
        return None
    median = float(np.median(values))
    reach = OUTLIER_DEVIATIONS * max(float(robust_deviation(values)), TYPICAL_DEVIATION)
    return median - reach, median + reach


def without_agreement(sessions: Sequence[tuple[Hashable, float]]) -> list[bool]:
    """Whether no session of another unit is within AGREEMENT, for each session (unit, log ratio).

    The unit is the key of the network, or of the installation if the network is unknown.
    """
    return [not agreed for agreed in corroborated(sessions)]


@dataclass(frozen=True)
class Agreement:
    """The usual range of a pool of installations, and how many known networks are within it."""

    low: float
    median: float
    high: float
    networks: int

    def witnesses(self, log_ratio: float, reach: float = math.inf) -> int:
        """How many independent networks agree with `log_ratio`; 0 if it is outside the range, or farther than
        `reach` from the median.
        """
        agrees = self.low <= log_ratio <= self.high and abs(log_ratio - self.median) <= reach
        return self.networks if agrees else 0


def agreement(networks: Sequence[Hashable | None], log_ratios: Sequence[float]) -> Agreement:
    """Which networks of a pool agree with each other, by the outlier rule.

    The pool contains the installations of one model, or of all models with the same chip, backend and
    processor class. `networks`: the network of each installation, None if unknown: these count for the range,
    but are not witnesses. `log_ratios`: the mean of each installation. A network counts once.

    For fewer than LEAST_UNITS units, the range is AGREEMENT around the median.
    """
    pool = units(
        InstallationValue(value, 0.0, 1, network) for value, network in zip(log_ratios, networks, strict=True)
    )
    if not pool:
        return Agreement(math.inf, 0.0, -math.inf, 0)
    logs = [unit.log_ratio for unit in pool]
    median = float(np.median(logs))
    low, high = usual_range(logs) or (median - AGREEMENT, median + AGREEMENT)
    inside = sum(unit.network is not None and low <= unit.log_ratio <= high for unit in pool)
    return Agreement(low, median, high, inside)


def mean_of(figures: Sequence[Estimate], weights: ArrayLike | None = None) -> Estimate:
    """The mean of one or more independent `figures` of device models, with the uncertainty of these.

    Degrees of freedom: Welch and Satterthwaite. Without `weights` (n,), a figure farther than FAR_APART from
    all others counts like the nearest of them: see `within_reach`. With LEAST_MODELS, single assumed
    deviations do not matter.
    """
    logs = np.array([each.log for each in figures])
    if weights is None:
        logs = within_reach(logs)
    shares = np.ones(len(figures)) if weights is None else np.asarray(weights, dtype=np.float64)
    squares = [(share * each.error) ** 2 for share, each in zip(shares.tolist(), figures, strict=True)]
    spread = math.fsum(square**2 / each.degrees for square, each in zip(squares, figures, strict=True))
    total = math.fsum(squares)
    return Estimate(
        log=float(np.average(logs, weights=shares)),
        error=math.sqrt(total) / float(shares.sum()),
        degrees=total**2 / spread,
        assumed=len(figures) < LEAST_MODELS and any(each.assumed for each in figures),
    )


def within_reach(logs: ArrayLike, weights: ArrayLike | None = None) -> NDArray[np.float64]:
    """`logs` (n,), limited to the range of their largest group. Gaps of more than FAR_APART separate groups.

    A group is as large as the `weights` (n,) of its members, 1 if not given.

    Speedups of real models lie close together, however much families of chips differ: an invented one that
    is larger than all others by more than that changes the mean like the largest of them. Of two equal
    groups the lower one counts.
    """
    values = np.asarray(logs, dtype=np.float64)
    shares = np.ones(values.size) if weights is None else np.asarray(weights, dtype=np.float64)
    order = np.argsort(values)
    groups = np.split(order, np.flatnonzero(np.diff(values[order]) > FAR_APART) + 1)
    largest = max(groups, key=lambda group: float(shares[group].sum()))
    return values.clip(values[largest[0]], values[largest[-1]])


@dataclass(frozen=True)
class CrowdSpeedup:
    """The mean speedup over device models.

    `measured`: with the interval for the mean of these models, whose only source is their own uncertainty.
    `population`: with the interval for the mean of all models that might be measured, None for fewer than
    LEAST_SAMPLE.
    """

    measured: Interval
    population: Interval


def crowd_speedup(figures: Sequence[Estimate], weights: ArrayLike | None = None) -> CrowdSpeedup | None:
    """The mean over `figures` of device models with `weights` (n,), 1 if not given. None without figures."""
    if not figures:
        return None
    shares = np.ones(len(figures)) if weights is None else np.asarray(weights, dtype=np.float64)
    measured = interval_of(mean_of(figures, weights))
    population = Interval(measured.value, None, None)
    if measured.low and measured.high and shares.sum() >= LEAST_SAMPLE:
        low, high = map(math.exp, sample_interval([each.log for each in figures], shares))
        population = Interval(measured.value, min(low, measured.low), max(high, measured.high))
    return CrowdSpeedup(measured, population)


def sample_interval(logs: ArrayLike, weights: ArrayLike | None = None) -> NDArray[np.float64]:
    """The 95 % interval (2, ...) for the mean of the population of which `logs` (..., n), n > 2, are a
    sample.

    `weights` (n,) are 1 if not given. With others, the sample is as large as Kish's effective size.

    It spans Student's t interval and that of Hall (1992), who transforms t monotonically by the skewness:
    crowds in which a minority of chips is much faster are skewed.
    """
    values = np.asarray(logs, dtype=np.float64)
    shares = np.ones(values.shape[-1]) if weights is None else np.asarray(weights, dtype=np.float64)
    count = float(shares.sum() ** 2 / (shares**2).sum())
    mean = np.average(values, axis=-1, weights=shares)
    second, third = (
        np.average((values - mean[..., None]) ** power, axis=-1, weights=shares) for power in (2, 3)
    )
    deviation = np.sqrt(second * count / (count - 1))
    scale = np.maximum(deviation, TINY)
    third = third / scale**3
    skewness = third * math.sqrt(count * (count - 1)) / (count - 2)
    skewness = np.where(np.abs(skewness) < LEAST_SKEWNESS, LEAST_SKEWNESS, skewness)
    t = t_quantile(count - 1, 1 - CONFIDENCE) / math.sqrt(count)
    ends = [
        3 / skewness * (np.cbrt(1 + skewness * (sign * t - skewness / (6 * count))) - 1) for sign in (1, -1)
    ]
    low = mean - deviation * np.maximum(ends[0], t)
    high = mean - deviation * np.minimum(ends[1], -t)
    return np.stack([low, high])


def interval_of(figure: Estimate) -> Interval:
    """exp(`figure`) with its two-sided t interval; no bounds if its uncertainty is assumed."""
    if figure.assumed:
        return Interval(math.exp(figure.log), None, None)
    return _interval(figure.log, figure.error, figure.degrees)


def estimate(logs: ArrayLike) -> Estimate:
    """The mean of independent `logs` (n,); that of a single one has no error. Raises ValueError for none."""
    values = np.asarray(logs, dtype=np.float64)
    if values.size == 0:
        raise ValueError("an estimate from no values")
    error = float(values.std(ddof=1)) / math.sqrt(values.size) if values.size > 1 else 0.0
    return Estimate(float(values.mean()), error, values.size - 1, assumed=values.size < 2)


def ratio_between(one: Estimate, other: Estimate) -> Interval:
    """exp(`one` - `other`) with Welch's two-sided t interval (Welch 1947); no bounds if one is assumed."""
    difference, variance = one.log - other.log, one.error**2 + other.error**2
    if one.assumed or other.assumed or not variance:
        return Interval(math.exp(difference), None, None)
    degrees = variance**2 / (one.error**4 / one.degrees + other.error**4 / other.degrees)
    return _interval(difference, math.sqrt(variance), degrees)
