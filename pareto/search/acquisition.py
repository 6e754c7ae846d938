"""Expected hypervolume improvement of a candidate whose objectives are independent Gaussians.

The expected improvement is the integral of P(candidate <= w) over the region that no front point covers
(Emmerich et al. 2006). For one and two objectives the region is a staircase and the integral is closed
(Hupkens et al. 2015); for more, it is taken over points drawn in the region. All objectives are minimised.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from pareto.fronts.front import nondominated

Array = NDArray[np.float64]

SAMPLES = 1024  # points of the region for three objectives; half as many for more, which cost more each


def expected_improvement(
    mean: Array, spread: Array, front: Array, reference: Array, rng: np.random.Generator
) -> Array:
    """Return the expected gain in hypervolume below `reference` for each candidate.

    `mean` and `spread` are (candidates, objectives), spread above 0; `front` is (points, objectives), any
    points: those dominated or beyond the reference are ignored. `rng` is used from three objectives on.
    """
    if not len(mean):
        return np.empty(0)
    front = front[(front < reference).all(axis=1)]
    front = front[nondominated(front)] if len(front) else np.empty((0, len(reference)))
    if len(reference) == 1:
        best = min(float(reference[0]), *front[:, 0].tolist()) if len(front) else float(reference[0])
        return expected_fall(best, mean[:, 0], spread[:, 0])
    if len(reference) == 2:
        return _staircase(mean, spread, np.unique(front, axis=0), reference)
    return _sampled(mean, spread, front, reference, rng)


def expected_fall(bound: Array | float, mean: Array, spread: Array) -> Array:
    """Return E[max(bound - Y, 0)]: the integral of the normal distribution function up to `bound`."""
    z = (bound - mean) / spread
    density = np.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi)
    fall: Array = spread * (z * ndtr(z) + density)
    return fall


def _staircase(mean: Array, spread: Array, front: Array, reference: Array) -> Array:
    # Between two neighbouring front points, the uncovered region lies below the left one's second objective.
    edges = np.append(front[:, 0], reference[0])
    heights = np.concatenate([[reference[1]], front[:, 1]])
    width = expected_fall(edges, mean[:, :1], spread[:, :1])
    width[:, 1:] -= width[:, :-1].copy()
    improvement: Array = np.einsum("cs,cs->c", width, expected_fall(heights, mean[:, 1:], spread[:, 1:]))
    return improvement


def _sampled(mean: Array, spread: Array, front: Array, reference: Array, rng: np.random.Generator) -> Array:
    from scipy.stats import qmc  # takes a second to import, which listing the methods must not cost

    samples = SAMPLES if len(reference) == 3 else SAMPLES // 2
    # The box leaves out what only one candidate in a hundred might reach: the others need the points.
    lowest = np.minimum(np.quantile(mean - 3.0 * spread, 0.01, axis=0), reference - 1e-9)
    if len(front):
        lowest = np.minimum(lowest, front.min(axis=0))
    points = lowest + (reference - lowest) * qmc.Sobol(len(reference), rng=rng).random(samples)
    covered = np.zeros(samples, dtype=bool)
    for point in front:
        covered |= (points >= point).all(axis=1)
    free = points[~covered]
    chance = np.ones((len(mean), len(free)))
    for objective in range(len(reference)):
        chance *= ndtr((free[:, objective] - mean[:, objective, None]) / spread[:, objective, None])
    improvement: Array = chance.sum(axis=1) * float(np.prod(reference - lowest)) / samples
    return improvement
