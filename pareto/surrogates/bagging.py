"""Breiman's random forest on measured configurations, with the out-of-bag rows of each tree."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pareto.errors import ObjectiveError
from pareto.spaces.grid import Indices
from pareto.spaces.space import Space

LEAST_ROWS = 20  # fewer measurements give no result
MOST_ROWS = 4000  # more rows cost time without a better model
TREES = 100


@dataclass(frozen=True)
class Bagging:
    """Trees grown on bootstrap samples of `codes` (n, parameters) and `targets` (n).

    `targets` are on the scale on which they were learnt: logarithms when `log`. `rows` numbers the
    measurements they came from, and `unseen` has for each tree the positions in `codes` that its sample left
    out (out of bag, about 37 %).
    """

    trees: list[Any]
    codes: NDArray[np.float32]
    targets: NDArray[np.float64]
    rows: NDArray[np.int64]
    unseen: list[NDArray[np.int64]]
    log: bool


def grow(space: Space, indices: Indices, values: ArrayLike, seed: int = 0) -> Bagging | None:
    """Fit a forest to the measured `values` (n) of one objective at `indices` (n).

    NaN marks failures, which are left out. All-positive values are learnt as logarithms, as the explorer
    does: a cost is mostly a product of its causes. Of more than MOST_ROWS measurements a random selection is
    learnt. Returns None for fewer than LEAST_ROWS measurements, or when all have the same value. Equal seeds
    give equal forests. Raises ObjectiveError unless there is one value for each index.
    """
    from sklearn.ensemble import RandomForestRegressor

    measured = np.asarray(values, dtype=np.float64)
    indices = np.asarray(indices, dtype=np.int64)
    if measured.ndim != 1 or measured.shape != indices.shape:
        raise ObjectiveError(f"values of shape {measured.shape} do not fit {len(indices)} indices: one each")
    rows = np.flatnonzero(np.isfinite(measured))
    if len(rows) > MOST_ROWS:
        rows = np.sort(np.random.default_rng(seed).choice(rows, MOST_ROWS, replace=False))
    targets = measured[rows]
    if len(rows) < LEAST_ROWS or np.ptp(targets) == 0:
        return None
    log = bool(targets.min() > 0)
    if log:
        targets = np.log(targets)
    codes = space.codes(indices[rows]).astype(np.float32)
    forest = RandomForestRegressor(n_estimators=TREES, random_state=seed).fit(codes, targets)
    every = np.arange(len(rows))
    unseen = [np.setdiff1d(every, sample) for sample in forest.estimators_samples_]
    trees = [estimator.tree_ for estimator in forest.estimators_]
    return Bagging(trees, codes, targets, rows, unseen, log)
