"""The statistics from sessions to the crowd's figure: pure functions over NumPy arrays.

Each level is averaged before the next, so that each participant counts once: session (mean of paired log
ratios) -> installation (mean) -> network (mean) -> device model (robust mean, t interval over networks) ->
crowd (random-effects mean over models). Frames are not replicates of a run, sessions are not replicates of an
installation: an interval over them would be far too narrow.
"""

import math
from collections import Counter
from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowd.results.validity.measures import AGREEMENT, CONFIDENCE, OUTLIER_DEVIATIONS, t_quantile
from crowd.results.validity.plausibility import corroborated

LEAST_UNITS = 3
LEAST_SESSIONS = 3
LEAST_MODELS = 3
SESSIONS_PER_DAY = 5
# The median absolute deviation of normal values, times this, estimates their standard deviation.
NORMAL_MAD = 1.4826
# Honest installations of one model differ by a tenth. With few of them the deviation may be 0 by chance.
LEAST_DEVIATION = math.log(1.1)
# Huber's limit in standard deviations: values farther from the centre count as if they were at the limit.
# For normal values, the efficiency is 95 % of the mean's.
HUBER = 1.345
HUBER_EFFICIENCY = 0.950
# The mean of min(z^2, HUBER^2) over standard normal z.
HUBER_SQUARE = 0.7102
# Limits of the iterations, for six digits of a ratio.
HUBER_STEPS, CONVERGED = 30, 1e-9
BISECTIONS = 30
TINY = 1e-12
# The variance of three normal values exceeds this multiple of its median once in 64 times.
LARGEST_VARIANCE = 6.0
# Repeats of one device differ by more: a smaller scale is chance.
LEAST_SCALE = 0.02


def ratio(log_ratio: float) -> float:
    """The speedup of LOG_RATIO."""
    return math.exp(log_ratio)


def geometric_mean(ratios: Sequence[float]) -> float:
    """The geometric mean of one or more ratios. Ratios are never averaged arithmetically."""
    return math.exp(math.fsum(map(math.log, ratios)) / len(ratios))


@dataclass(frozen=True)
class Interval:
    """A ratio with its confidence interval; low and high are None for too few values."""

    value: float
    low: float | None
    high: float | None


def _interval(centre: float, deviation: float, count: int, least: int) -> Interval:
    """exp(CENTRE) with a two-sided t interval, from LEAST values on. COUNT values have DEVIATION."""
    if count < max(least, 2):
        return Interval(math.exp(centre), None, None)
    half = t_quantile(count - 1, 1 - CONFIDENCE) * deviation / math.sqrt(count)
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
    """Group INSTALLATIONS of one figure by network, with the mean of each group.

    An installation of unknown network is its own unit. Known networks come first.
    """
    known: dict[Hashable, list[InstallationValue]] = {}
    unknown = []
    for each in installations:
        if each.network is None:
            unknown.append([each])
        else:
            known.setdefault(each.network, []).append(each)
    return [
        Unit(
            log_ratio=math.fsum(each.log_ratio for each in members) / len(members),
            network=members[0].network,
            installations=len(members),
            sessions=sum(each.sessions for each in members),
        )
        for members in [*known.values(), *unknown]
    ]


def robust_mean(unit_logs: ArrayLike) -> NDArray[np.float64]:
    """Huber's robust mean over the last axis of UNIT_LOGS (..., n): (...). Raises ValueError without values.

    The scale is the median absolute deviation (Huber 1964), limited so that a value beyond AGREEMENT has no
    more influence than one at it. One value of four cannot move the result far, nor two of five; a
    Hodges-Lehmann estimate would follow those two.
    """
    values = np.asarray(unit_logs, dtype=np.float64)
    if values.shape[-1] == 0:
        raise ValueError("a robust mean of no values: give at least one")
    if values.shape[-1] < LEAST_UNITS:
        return np.asarray(values.mean(axis=-1))
    deviation = np.clip(robust_deviation(values), LEAST_SCALE, AGREEMENT / HUBER)
    scale = np.broadcast_to(deviation[..., None], values.shape)
    return _huber_mean(values, 1 / scale**2)[..., 0]


def robust_deviation(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """The standard deviation over the last axis of VALUES (..., n), by the median absolute deviation."""
    median = np.median(values, axis=-1, keepdims=True)
    found: NDArray[np.float64] = NORMAL_MAD * np.median(np.abs(values - median), axis=-1)
    return found


def _huber_mean(values: NDArray[np.float64], weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Huber's weighted mean over the last axis, which is kept. WEIGHTS are inverse variances.

    Iteratively reweighted from the median. Values beyond HUBER standard deviations count as if at the limit.
    """
    limit = HUBER / np.sqrt(weights)
    centre = np.median(values, axis=-1, keepdims=True)
    for _ in range(HUBER_STEPS):
        kept = weights * np.minimum(1.0, limit / np.maximum(np.abs(values - centre), TINY))
        following = (kept * values).sum(axis=-1, keepdims=True) / kept.sum(axis=-1, keepdims=True)
        step, centre = float(np.abs(following - centre).max()), following
        if step < CONVERGED:
            break
    return centre


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
    """The robust mean of the units of INSTALLATIONS, with a t interval from LEAST_UNITS on.

    Raises ValueError for no installation.
    """
    repeat = None
    if len(installations) == 1 and installations[0].sessions >= LEAST_SESSIONS:
        only = installations[0]
        repeat = _interval(only.log_ratio, only.deviation, only.sessions, LEAST_SESSIONS)
    found = units(installations)
    logs = np.array([unit.log_ratio for unit in found])
    deviation = float(logs.std(ddof=1)) if len(found) > 1 else None
    return ModelSpeedup(
        speedup=_interval(float(robust_mean(logs)), deviation or 0.0, len(found), LEAST_UNITS),
        repeat=repeat,
        sessions=sum(unit.sessions for unit in found),
        installations=len(installations),
        units=len(found),
        networks=sum(unit.network is not None for unit in found),
        deviation=deviation,
    )


@dataclass(frozen=True)
class ModelFigure:
    """A robust mean of logarithms over the `units` of a device model, with their standard deviation
    (None for a single unit).
    """

    log: float
    units: int
    deviation: float | None


def model_figure(installations: Sequence[InstallationValue]) -> ModelFigure:
    """The figure of a model from INSTALLATIONS. Raises ValueError for no installation."""
    found = model_speedup(installations)
    return ModelFigure(math.log(found.speedup.value), found.units, found.deviation)


def usual_range(unit_logs: ArrayLike) -> tuple[float, float] | None:
    """The range of log ratios in which a session is not an outlier, given UNIT_LOGS (n,) of its model.

    OUTLIER_DEVIATIONS robust standard deviations around the median (Leys et al. 2013), which outliers hardly
    influence. None for fewer than LEAST_UNITS units.
    """
    values = np.asarray(unit_logs, dtype=np.float64)
    if values.size < LEAST_UNITS:
        return None
    median = float(np.median(values))
    reach = OUTLIER_DEVIATIONS * max(float(robust_deviation(values)), LEAST_DEVIATION)
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
        """How many independent networks agree with LOG_RATIO; 0 if it is outside the range, or farther than
        REACH from the median.
        """
        agrees = self.low <= log_ratio <= self.high and abs(log_ratio - self.median) <= reach
        return self.networks if agrees else 0


def agreement(networks: Sequence[Hashable | None], log_ratios: Sequence[float]) -> Agreement:
    """Which networks of a pool agree with each other, by the outlier rule.

    The pool contains the installations of one model, or of all models with the same chip, backend and
    processor class. NETWORKS: the network of each installation, None if unknown: these count for the range,
    but are not witnesses. LOG_RATIOS: the mean of each installation. A network counts once.

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


def figure_variances(units: ArrayLike, deviations: Sequence[float | None]) -> NDArray[np.float64]:
    """The variance of each figure's log ratio (n,), from the pooled variance within models.

    UNITS (n,) and DEVIATIONS are those of each figure's `ModelSpeedup`. Three values estimate a variance
    badly; the pooled variance has the degrees of freedom of all models. The variance of a model counts at
    most LARGEST_VARIANCE times the median, so that a hostile model cannot make all others look uncertain. 0
    if no figure has two units.
    """
    counts = np.asarray(units, dtype=np.float64)
    squares = np.array([0.0 if deviation is None else deviation**2 for deviation in deviations])
    measured = counts > 1
    if not measured.any():
        return np.zeros(counts.shape)
    limited = np.minimum(squares, LARGEST_VARIANCE * np.median(squares[measured]))
    pooled = float(((counts - 1) * limited).sum() / (counts - 1).sum())
    return pooled / counts


def crowd_speedup(figures: Sequence[tuple[float, float]]) -> Interval | None:
    """The random-effects mean over FIGURES (log ratio, variance) of device models, None without figures.

    It has an interval from LEAST_MODELS on.
    """
    if not figures:
        return None
    logs, variances = np.array(figures, dtype=np.float64).T
    if len(figures) < LEAST_MODELS:
        return Interval(math.exp(float(logs.mean())), None, None)
    mean, error = random_effects(logs, variances)
    half = t_quantile(len(figures) - 1, 1 - CONFIDENCE) * float(error)
    return Interval(math.exp(float(mean)), math.exp(float(mean) - half), math.exp(float(mean) + half))


@dataclass(frozen=True)
class Estimate:
    """A mean of logarithms with its variance and `degrees` of freedom; with 0 the variance is unknown."""

    log: float
    variance: float
    degrees: float


def estimate(logs: ArrayLike) -> Estimate:
    """The mean of independent LOGS (n,). Raises ValueError for none."""
    values = np.asarray(logs, dtype=np.float64)
    if values.size == 0:
        raise ValueError("an estimate from no values")
    variance = float(values.var(ddof=1)) / values.size if values.size > 1 else 0.0
    return Estimate(float(values.mean()), variance, values.size - 1)


def own_estimate(figure: ModelFigure) -> Estimate:
    """FIGURE with the variance of its own units alone. Raises ValueError for fewer than two units."""
    if figure.deviation is None:
        raise ValueError(f"{figure.units} unit has no variance: give a figure of two or more")
    return Estimate(figure.log, figure.deviation**2 / figure.units, figure.units - 1)


def pooled_estimates(figures: Sequence[ModelFigure]) -> list[Estimate]:
    """FIGURES with the pooled variance of `figure_variances`."""
    variances = figure_variances([each.units for each in figures], [each.deviation for each in figures])
    degrees = sum(each.units - 1 for each in figures)
    return [Estimate(each.log, float(v), degrees) for each, v in zip(figures, variances, strict=True)]


def ratio_between(one: Estimate, other: Estimate, same_pool: bool = False) -> Interval:
    """exp(ONE - OTHER) with Welch's two-sided t interval (Welch 1947); no bounds if a variance is unknown.

    SAME_POOL: both variances come from the same values, whose degrees of freedom count once.
    """
    difference, variance = one.log - other.log, one.variance + other.variance
    if min(one.degrees, other.degrees) < 1 or variance <= 0:
        return Interval(math.exp(difference), None, None)
    degrees = one.degrees
    if not same_pool:
        degrees = variance**2 / (one.variance**2 / one.degrees + other.variance**2 / other.degrees)
    half = t_quantile(degrees, 1 - CONFIDENCE) * math.sqrt(variance)
    return Interval(math.exp(difference), math.exp(difference - half), math.exp(difference + half))


def random_effects(
    logs: NDArray[np.float64], variances: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The random-effects mean over the last axis of LOGS, and its standard error: two arrays (...).

    LOGS and VARIANCES are (..., n), n > 1. Weights are inverse variances 1 / (v + tau^2). tau^2, the variance
    between models, is Paule and Mandel's (1982); the error is Knapp and Hartung's (2003) with the factor
    max(1, q) (Roever et al. 2015). Residuals beyond HUBER standard deviations count as HUBER in all three, so
    that a few invented models change little (Huber 1964, proposal 2).
    """
    count = logs.shape[-1]
    low = np.zeros((*logs.shape[:-1], 1))
    high = count * np.ptp(logs, axis=-1, keepdims=True) ** 2 + TINY
    for _ in range(BISECTIONS):
        between = (low + high) / 2
        excess = _squares(logs, 1 / (variances + between + TINY)) > (count - 1) * HUBER_SQUARE
        low, high = np.where(excess, between, low), np.where(excess, high, between)
    weights = 1 / (variances + low + TINY)
    q = _squares(logs, weights) / ((count - 1) * HUBER_SQUARE)
    variance = np.maximum(1.0, q) / (HUBER_EFFICIENCY * weights.sum(axis=-1, keepdims=True))
    return _huber_mean(logs, weights)[..., 0], np.sqrt(variance)[..., 0]


def _squares(logs: NDArray[np.float64], weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sum over the last axis, kept, of the squared standardised residuals, each at most HUBER^2."""
    residuals = (logs - _huber_mean(logs, weights)) ** 2 * weights
    total: NDArray[np.float64] = np.minimum(residuals, HUBER**2).sum(axis=-1, keepdims=True)
    return total
