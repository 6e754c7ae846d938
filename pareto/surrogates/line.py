"""A straight line from one device's values to another's, shrunk by its uncertainty."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LEAST = 4  # points needed for a slope
SURE = 2.5  # standard errors from zero, from which on a slope counts
FENCE = 1.5  # interquartile ranges beyond the quartiles: Tukey's rule for outliers


class Line(NamedTuple):
    """y = offset + slope * x. `t` is the plain least-squares slope in standard errors."""

    slope: float
    offset: float
    t: float


def fitted_line(x: Array, y: Array) -> Line:
    """Return the least-squares line through the points, pulled in at Tukey's fences, its slope shrunk.

    The slope is multiplied by max(0, 1 - (SURE / t)^2), the nonnegative garrote of Breiman 1995 for a single
    coefficient: up to SURE standard errors it is zero, and a significant one is hardly changed. By chance 20
    unrelated points exceed it in one of fifty cases, fewer points more often. Fewer than LEAST points, or
    points of one x, have slope 0 and t 0: the line is then their mean y.
    """
    x, y = _pulled_in(x), _pulled_in(y)
    middle = float(x.mean()), float(y.mean())
    dx, dy = x - middle[0], y - middle[1]
    wide, high = float(np.abs(dx).max()), float(np.abs(dy).max())
    if len(x) < LEAST or wide <= 1e-9 * float(np.abs(x).max()) or high == 0:
        return Line(0.0, middle[1], 0.0)
    dx, dy = dx / wide, dy / high
    power = float(dx @ dx)
    slope = float(dx @ dy) / power
    rest = dy - slope * dx
    error = math.sqrt(float(rest @ rest) / (len(x) - 2) / power)
    t = slope / max(error, 1e-15)
    shrunk = slope * high / wide * (1.0 - (SURE / t) ** 2) if abs(t) > SURE else 0.0
    return Line(shrunk, middle[1] - shrunk * middle[0], t)


def _pulled_in(values: Array) -> Array:
    """Return the values winsorised at Tukey's fences, so that one outlier cannot turn the line."""
    low, high = np.quantile(values, [0.25, 0.75])
    reach = FENCE * (high - low)
    return np.clip(values, low - reach, high + reach) if reach > 0 else values
