"""The normal distribution above a bound: the mean of a value that is known to be that or larger."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import erfcx

Array = NDArray[np.float64]


def truncated_mean(mean: Array, deviation: Array, bound: Array) -> Array:
    """Return (n,) E[X | X >= bound] of normal X, elementwise: never below the bound, nor below the mean.

    mean + deviation * h(z), z = (bound - mean) / deviation, with the hazard h of the standard normal
    distribution (Greene 2012, theorem 19.2). As a ratio of density and tail it is 0 / 0 far above the mean;
    by the scaled complementary error function it is sqrt(2 / pi) / erfcx(z / sqrt(2)), which is not.
    """
    z = (bound - mean) / deviation
    hazard: Array = math.sqrt(2.0 / math.pi) / erfcx(z / math.sqrt(2.0))
    return np.maximum(mean + deviation * hazard, bound)
