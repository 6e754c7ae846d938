"""Parameter importance: the share of an objective's variance that is lost without the parameter."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pareto.spaces.grid import Indices
from pareto.spaces.space import Space
from pareto.surrogates.bagging import Bagging, grow


def importance(space: Space, indices: Indices, values: ArrayLike, seed: int = 0) -> dict[str, float] | None:
    """Return each parameter's share of the variance of one objective, in the order of the space.

    `values` (n) were measured at `indices` (n), NaN where a measurement failed; positive values are taken as
    logarithms. For every tree of a random forest, the rows that it never saw are predicted as they are and
    with one parameter's values permuted among them (Breiman 2001, section 10); the growth of the squared
    error, over twice the variance, is the share. For a true model and independent parameters, as in a random
    sample, that is the total-effect Sobol index, which Jansen 1999 estimates by the same differences; a
    forest knows the model only roughly. Interactions count for each of their parameters, so shares may add
    up to more than 1, and noise for none, so they may add up to less. Where a search has gathered its
    measurements near the front, parameters depend on each other, and shares only hint at what matters there.

    An irrelevant parameter has 0. None for fewer than 20 measurements or values that are all equal. Equal
    seeds give equal answers.
    """
    bagging = grow(space, indices, values, seed)
    return None if bagging is None else dict(zip(space.names, shares(bagging, seed), strict=True))


def shares(bagging: Bagging, seed: int = 0) -> list[float]:
    """Return the share of each parameter, as `importance` does, from a fitted forest."""
    rng = np.random.default_rng(seed)
    growth = np.zeros(bagging.codes.shape[1])
    for tree, unseen in zip(bagging.trees, bagging.unseen, strict=True):
        codes, targets = bagging.codes[unseen], bagging.targets[unseen]
        # One table with a copy of the rows for each parameter, that one permuted, and the rows as they are.
        copies = np.tile(codes, (len(growth) + 1, 1, 1))
        for column in range(len(growth)):
            copies[column, :, column] = rng.permutation(codes[:, column])
        predicted = tree.predict(copies.reshape(-1, codes.shape[1])).reshape(copies.shape[:2])
        errors = ((predicted - targets) ** 2).sum(axis=1)
        growth += errors[:-1] - errors[-1]
    variance = bagging.targets.var() * sum(map(len, bagging.unseen))
    shares: list[float] = np.maximum(growth / (2.0 * variance), 0.0).tolist()
    return shares
