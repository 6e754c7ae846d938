"""The hypervolume indicator: how much of the objective space a set of points dominates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from pareto.errors import ObjectiveError


def hypervolume(
    points: ArrayLike, reference: ArrayLike, maximise: Sequence[bool] | None = None, log: bool = False
) -> float:
    """Return the volume that `points` (n, objectives) dominate up to `reference` (objectives).

    Objectives are minimised unless `maximise` says otherwise. Points that do not reach the reference, and
    rows with NaN, add nothing; no points, no volume. With `log`, volumes are of the values' logarithms, so
    that halving any objective anywhere counts alike; values must be positive then. Computed by moocore.

    Raises ObjectiveError on shapes that do not fit or values without a logarithm.
    """
    bounds = np.asarray(reference, dtype=np.float64)
    table = np.asarray(points, dtype=np.float64)
    if table.size == 0:
        return 0.0
    if table.ndim != 2 or bounds.shape != (table.shape[1],):
        raise ObjectiveError(f"points of shape {table.shape} do not fit a reference of shape {bounds.shape}")
    table = table[~np.isnan(table).any(axis=1)]
    if log:
        if (table <= 0).any() or (bounds <= 0).any():
            raise ObjectiveError("only positive values have a logarithm: use log=False")
        table, bounds = np.log(table), np.log(bounds)
    sign = np.where(
        np.zeros(len(bounds), dtype=bool) if maximise is None else np.asarray(maximise), -1.0, 1.0
    )
    table, bounds = table * sign, bounds * sign
    table = table[(table < bounds).all(axis=1)]
    if len(table) == 0:
        return 0.0
    if table.shape[1] == 1:
        return float(bounds[0] - table.min())
    import moocore

    return float(moocore.hypervolume(table, ref=bounds))
