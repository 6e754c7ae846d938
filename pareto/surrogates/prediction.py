"""Predicted against measured: how well a model predicts measurements that it has not seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pareto.spaces.grid import Indices
from pareto.spaces.space import Space
from pareto.surrogates.bagging import Bagging, grow


@dataclass(frozen=True)
class Prediction:
    """`measured` and `predicted` values (n) of one objective, in its own unit, and how well they agree.

    `rows` numbers them among the values that were given. `spearman` is the correlation of the ranks: whether
    the model ranks them correctly. `r2` is the share of the variance that it predicts, of the logarithms when
    `log`: 1 is perfect, 0 no better than the mean, below 0 worse. `spearman` is None when all predictions are
    equal.
    """

    rows: NDArray[np.int64]
    measured: NDArray[np.float64]
    predicted: NDArray[np.float64]
    spearman: float | None
    r2: float
    log: bool


def predictions(space: Space, indices: Indices, values: ArrayLike, seed: int = 0) -> Prediction | None:
    """Return out-of-bag predictions of the measured `values` (n) of one objective at `indices` (n).

    Each is the mean of those trees of a random forest that did not learn from the row (Breiman 2001), so none
    has seen its target. NaN marks failures, which are left out; of very many measurements a random selection
    is taken. None for fewer than 20 measurements or values that are all equal. Equal seeds give equal
    answers.
    """
    bagging = grow(space, indices, values, seed)
    return None if bagging is None else out_of_bag(bagging)


def out_of_bag(bagging: Bagging) -> Prediction:
    """Return the predictions, as `predictions` does, from a fitted forest."""
    from scipy.stats import rankdata

    total, count = np.zeros(len(bagging.targets)), np.zeros(len(bagging.targets))
    for tree, unseen in zip(bagging.trees, bagging.unseen, strict=True):
        total[unseen] += tree.predict(bagging.codes[unseen])[:, 0]
        count[unseen] += 1
    predictable = np.flatnonzero(count)  # a row that every tree has seen has no out-of-bag prediction
    predicted, targets = total[predictable] / count[predictable], bagging.targets[predictable]
    r2 = 1.0 - ((targets - predicted) ** 2).sum() / ((targets - targets.mean()) ** 2).sum()
    ranks = np.stack([rankdata(predicted), rankdata(targets)])
    spearman = float(np.corrcoef(ranks)[0, 1]) if np.ptp(ranks, axis=1).all() else None
    if bagging.log:
        predicted, targets = np.exp(predicted), np.exp(targets)
    return Prediction(bagging.rows[predictable], targets, predicted, spearman, float(r2), bagging.log)
