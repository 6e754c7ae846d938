"""The hypervolume indicator: how much of the objective space a set of points dominates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pareto.errors import ObjectiveError
from pareto.fronts.front import signs

FIRST = 10  # points that fix the reference


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
    sign = signs(maximise, len(bounds))
    table, bounds = table * sign, bounds * sign
    table = table[(table < bounds).all(axis=1)]
    if len(table) == 0:
        return 0.0
    if table.shape[1] == 1:
        return float(bounds[0] - table.min())
    import moocore

    return float(moocore.hypervolume(table, ref=bounds))


def reference_point(
    points: ArrayLike, limits: Sequence[float | None] | None = None, maximise: Sequence[bool] | None = None
) -> NDArray[np.float64]:
    """Return where the volume of `points` (n, objectives) ends: at the limits, else at the worst early value.

    That is the worst of the FIRST points, so that later ones do not move the reference.
    `limits` has a number or None for each objective. Rows with NaN do not count. Raises ObjectiveError when
    no row is left, or on limits that do not fit.
    """
    table = np.asarray(points, dtype=np.float64)
    if table.ndim != 2 or np.isnan(table).any(axis=1).all():
        raise ObjectiveError("nothing was measured yet: there is no worst value to start from")
    table = table[~np.isnan(table).any(axis=1)]
    count = table.shape[1]
    bounds = [None] * count if limits is None else list(limits)
    if len(bounds) != count:
        raise ObjectiveError(f"{len(bounds)} limits do not fit {count} objectives: one each, or None")
    sign = signs(maximise, count)
    worst = (table[:FIRST] * sign).max(axis=0) * sign
    return np.array(
        [value if bound is None else bound for value, bound in zip(worst, bounds, strict=True)],
        dtype=np.float64,
    )


def hypervolume_growth(
    points: ArrayLike, limits: Sequence[float | None] | None = None, maximise: Sequence[bool] | None = None
) -> NDArray[np.float64]:
    """Return the hypervolume after each of `points` (n, objectives), in the order they were measured.

    All volumes end at one reference, `reference_point` of all the points, and are of logarithms where all
    values and limits are positive; so the numbers never fall; only their growth is meaningful. A row
    with NaN, a failure, adds nothing but has its place. Nothing measured has volume 0.
    """
    table = np.asarray(points, dtype=np.float64)
    if table.size == 0 or np.isnan(table).any(axis=1).all():
        return np.zeros(len(table))
    reference = reference_point(table, limits, maximise)
    log = bool(np.nanmin(table) > 0 and reference.min() > 0)
    sign = signs(maximise, len(reference))
    minimised, bound = table * sign, reference * sign
    volumes = np.zeros(len(table))
    front: list[int] = []
    for number, row in enumerate(minimised):
        volumes[number] = volumes[number - 1] if number else 0.0
        # Most measurements are dominated or out of bounds: only the others change the volume.
        if not (row < bound).all() or (minimised[front] <= row).all(axis=1).any():
            continue
        front = [other for other in front if not (row <= minimised[other]).all()] + [number]
        volumes[number] = max(volumes[number], hypervolume(table[front], reference, maximise, log))
    return volumes
