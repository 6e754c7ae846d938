"""Where a front may go on: how far a point is expected beyond what was measured, objective by objective.

A search that polishes a short front learns ever better what lies beside it, and less and less of anything
else. Whether the front ends where it seems to is another question, for models of all values: is a point to
be expected whose one objective is less than any yet, whatever the others are within the limits?
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from pareto.search.improvement import expected_fall

Array = NDArray[np.float64]

ENOUGH = 0.03  # of an objective's range: what less is expected to bring is no reason to look


def beyond_ends(mean: Array, spread: Array, least: Array, limits: Array, extent: Array) -> Array:
    """Return how far each candidate is expected beyond the front's ends, where that is far enough; or 0.

    `mean` and `spread` are (candidates, objectives), spread above 0; `least` are the (objectives) lowest
    values known, `limits` what an objective may have at most, infinity where there is none, and `extent` the
    ranges in shares of which the answer is. It is the most that any one objective is expected to fall, times
    the chance that all others keep their limits. All objectives are minimised and independent Gaussians.
    """
    keeps = ndtr((limits - mean) / spread)
    fall = expected_fall(least, mean, spread) / extent
    for objective in range(mean.shape[1]):
        fall[:, objective] *= np.delete(keeps, objective, axis=1).prod(axis=1)
    best = fall.max(axis=1)
    return np.where(best > ENOUGH, best, 0.0)
