"""The expected gain of measuring a configuration once more.

A further measurement moves the posterior mean of its configuration, and a front of posterior means may gain
by that: a point moves on it, rises onto it, or makes room for the one behind it. The expected gain is in
hypervolume, as that of a new point is, so the two compete.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from pareto.search.acquisition import expected_improvement
from pareto.search.models import Models
from pareto.search.targets import TINY

Array = NDArray[np.float64]

REPEATS = 5  # measurements of one configuration at most: the mean of five has less than half the deviation


def repeat_gains(models: Models, pending: Collection[int], rng: np.random.Generator) -> Array:
    """Return the (n,) expected gain in hypervolume by one more measurement of each measured configuration.

    It is zero while nothing was repeated, where repeats agree, and for `pending` points. A configuration that
    ever failed or has a censored value is not repeated.
    """
    targets, noise = models.targets, models.noise
    gains = np.zeros(len(targets.indices))
    waiting = np.isin(targets.indices, list(pending))
    if not noise:
        return gains
    mean, deviation = models.estimates
    variance = np.stack([models.variance(number) for number in range(mean.shape[1])], axis=1)
    # How far the mean moves: its variance less what the next measurement leaves of it.
    spread = deviation**2 / np.sqrt(np.maximum(deviation**2 + variance, TINY**2))
    spread = np.maximum(spread, TINY)
    front = targets.front_of(mean)
    free = ~waiting & (models.counts < REPEATS) & (models.counts == models.attempts)
    free &= (deviation > 0).any(axis=1) & targets.exact
    behind = free.copy()
    behind[front] = False
    if behind.any():
        gains[behind] = expected_improvement(
            mean[behind], spread[behind], mean[front], targets.reference, rng
        )
    for row in front[free[front]]:
        others = mean[front[front != row]]
        both = np.stack([spread[row], np.full_like(spread[row], TINY)])
        moved, as_it_is = expected_improvement(
            np.stack([mean[row], mean[row]]), both, others, targets.reference, rng
        )
        gains[row] = max(moved - as_it_is, 0.0)
    return gains
