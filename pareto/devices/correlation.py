"""How similarly two devices rank and scale the same configurations: Pearson and Spearman with intervals."""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pareto.errors import ObjectiveError

Array = NDArray[np.float64]

MINIMUM = 5  # common configurations; the coverage of both intervals was tested from 5 upwards
PERFECT = 1e-12  # a correlation this near to 1 differs from it by rounding only


@dataclass(frozen=True)
class Estimate:
    """A correlation coefficient in -1 .. 1 and its confidence interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Correlation:
    """Of `count` configurations measured on both devices: `pearson` of the values, `spearman` of their ranks.

    Pearson asks whether one device's values predict the other's up to a factor and an offset, or, of
    logarithms, up to a factor and a power; Spearman only whether both put the configurations in one order.
    """

    count: int
    pearson: Estimate
    spearman: Estimate


def correlate(
    first: ArrayLike, second: ArrayLike, *, log: bool = False, level: float = 0.95, minimum: int = MINIMUM
) -> Correlation | None:
    """Return the correlation of two devices' values (n,) of the same n configurations in one order.

    A pair with NaN, a configuration that either device did not measure, is left out. None when fewer than
    `minimum` pairs remain or when one device's values (with `log`, their logarithms) are all equal: no
    estimate is possible then. With `log`, Pearson is that of the logarithms, which suits times; Spearman is
    the same either way. `level` is how often the intervals cover the truth, for pairs drawn independently
    and, for Pearson, jointly normal.

    Raises ObjectiveError on shapes that do not fit, infinities, or values without a logarithm.
    """
    if not 0.0 < level < 1.0:
        raise ObjectiveError(f"level = {level!r} must lie between 0 and 1: 0.95, for example")
    x, y = (np.asarray(values, dtype=np.float64) for values in (first, second))
    if x.ndim != 1 or x.shape != y.shape:
        raise ObjectiveError(f"values of shapes {x.shape} and {y.shape} are not pairs: give one row each")
    both = ~(np.isnan(x) | np.isnan(y))
    x, y = x[both], y[both]
    if np.isinf(x).any() or np.isinf(y).any():
        raise ObjectiveError("an infinite value has no correlation: use NaN where nothing was measured")
    if log and min(x.min(initial=1.0), y.min(initial=1.0)) <= 0:
        raise ObjectiveError("only positive values have a logarithm: use log=False")
    ranks = _ranks(x), _ranks(y)
    if log:
        x, y = np.log(x), np.log(y)
    if len(x) < max(minimum, 4) or np.ptp(x) == 0 or np.ptp(y) == 0:
        return None
    return Correlation(
        len(x), _fisher(_pearson(x, y), len(x), level), _bonett_wright(_pearson(*ranks), len(x), level)
    )


def correlation_matrix(
    values: ArrayLike, *, log: bool = False, level: float = 0.95, minimum: int = MINIMUM
) -> list[list[Correlation | None]]:
    """Return the correlation of every two rows of `values` (devices, configurations), NaN where unmeasured.

    Symmetric; None on the diagonal, and where `correlate` returns None.
    """
    table = np.asarray(values, dtype=np.float64)
    if table.ndim != 2:
        raise ObjectiveError(f"values of shape {table.shape} are not (devices, configurations)")
    matrix: list[list[Correlation | None]] = [[None] * len(table) for _ in table]
    for row in range(len(table)):
        for column in range(row):
            answer = correlate(table[row], table[column], log=log, level=level, minimum=minimum)
            matrix[row][column] = matrix[column][row] = answer
    return matrix


def ranks_of_best(values: ArrayLike, maximise: bool = False) -> NDArray[np.float64]:
    """Return (devices, devices) ranks: entry [i, j] is the rank of device i's best configuration on device j.

    `values` is (devices, configurations), lower better unless `maximise`, NaN where unmeasured. A rank is
    counted among what both devices measured: 1 is best, and ties share the mean of their places, so the
    diagonal is 1 unless the best is tied. NaN where the two have nothing in common.

    Raises ObjectiveError on infinities.
    """
    table = np.asarray(values, dtype=np.float64) * (-1 if maximise else 1)
    if np.isinf(table).any():
        raise ObjectiveError("an infinite value has no rank: use NaN where nothing was measured")
    ranks = np.full((len(table), len(table)), np.nan)
    for i, reference in enumerate(table):
        for j, other in enumerate(table):
            both = np.flatnonzero(~(np.isnan(reference) | np.isnan(other)))
            if len(both):
                ranks[i, j] = _ranks(other[both])[np.argmin(reference[both])]
    return ranks


def _ranks(values: Array) -> Array:
    """Return ranks from 1; equal values share the mean of their places."""
    _, group, counts = np.unique(values, return_inverse=True, return_counts=True)
    last = np.cumsum(counts)
    return (last - (counts - 1) / 2)[group]


def _pearson(x: Array, y: Array) -> float:
    x, y = x - x.mean(), y - y.mean()
    # Scaled first: squares of tiny or huge values would leave the range of a double.
    x, y = x / np.abs(x).max(), y / np.abs(y).max()
    return float(np.clip(x @ y / math.sqrt(float(x @ x) * float(y @ y)), -1.0, 1.0))


def _fisher(value: float, count: int, level: float) -> Estimate:
    """Fisher 1921: artanh(r) is about normal with variance 1 / (n - 3)."""
    perfect = 1.0 - abs(value) < PERFECT
    centre = _short_of_perfect(value, count) if perfect else value
    return _interval(value, centre, math.sqrt(1.0 / (count - 3)), level)


def _bonett_wright(value: float, count: int, level: float) -> Estimate:
    """Bonett & Wright 2000: artanh(rs) is about normal with variance (1 + rs^2 / 2) / (n - 3)."""
    error = math.sqrt((1.0 + value**2 / 2) / (count - 3))
    return _interval(value, _short_of_perfect(value, count), error, level)


def _short_of_perfect(value: float, count: int) -> float:
    """Return the centre of an interval: at most half a step of rs below 1.

    A perfect sample does not prove a perfect correlation, and artanh(1) is infinite.
    """
    half_step = 6.0 / (count * (count**2 - 1))
    return math.copysign(min(abs(value), 1.0 - half_step), value)


def _interval(value: float, centre: float, error: float, level: float) -> Estimate:
    reach = NormalDist().inv_cdf(0.5 + level / 2) * error
    low, high = math.tanh(math.atanh(centre) - reach), math.tanh(math.atanh(centre) + reach)
    return Estimate(value, min(low, value), max(high, value))
