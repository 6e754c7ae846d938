"""Pareto fronts: the non-dominated points, and choosing one of them.

Needs NumPy only, so that a device can carry a front and choose from it. All objectives are minimised
unless `maximise` says otherwise. A point dominates another when it is at least as good in every objective and
better in one; equal points do not dominate each other, so duplicates are kept or dropped together.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pareto.errors import ObjectiveError

Point = TypeVar("Point")
BLOCK = 1024  # rows compared with each other at once; 3 boolean BLOCK x BLOCK arrays stay in the cache
CELLS = 1 << 16  # of the coarse grid, half a MB that stays in the cache


class NothingWithinLimitsError(ObjectiveError):
    """No point of a front keeps the limits asked for."""


def nondominated(points: ArrayLike, maximise: Sequence[bool] | None = None) -> NDArray[np.bool_]:
    """Return a mask of the rows of `points` (n, objectives) that no other row dominates.

    Rows with NaN are failed measurements: never on the front, and never dominating. Infinities are compared
    like numbers. Exact: no tolerance, and rows equal to a front row are on the front too. O(n log n) for one
    and two objectives, and close to it for three; beyond that, quadratic only in the size of the front.

    Raises ObjectiveError unless `points` is a table with at least one column.
    """
    table = _minimised(points, maximise)
    mask = np.zeros(len(table), dtype=bool)
    columns = np.ascontiguousarray(table.T)
    rows = np.arange(len(table))
    if np.isnan(columns).any():
        rows = np.flatnonzero(~np.isnan(columns).any(axis=0))
        columns = columns[:, rows]
    for scale in (np.asarray, _ordinal):
        if len(rows) > 4 * BLOCK and len(columns) > 1:
            keep = _not_ruled_out(columns, scale)
            rows, columns = rows[keep], columns[:, keep]
    if len(rows):
        mask[rows] = _staircase(columns) if len(columns) <= 2 else _by_blocks(columns)
    return mask


def signs(maximise: Sequence[bool] | None, count: int) -> NDArray[np.float64]:
    """Return (count,) 1 for a minimised objective and -1 for a maximised one: values times it are minimised.

    Raises ObjectiveError unless `maximise` is None, which minimises all, or has one entry an objective.
    """
    if maximise is None:
        return np.ones(count)
    if len(maximise) != count:
        raise ObjectiveError(f"maximise has {len(maximise)} entries for {count} objectives")
    return np.where(np.asarray(maximise, dtype=bool), -1.0, 1.0)


def dominates(a: ArrayLike, b: ArrayLike) -> bool:
    """Return whether point `a` is nowhere worse than `b` and somewhere better (both minimised)."""
    left, right = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    return bool((left <= right).all() and (left < right).any())


def knee(points: ArrayLike, maximise: Sequence[bool] | None = None) -> int:
    """Return the row with the best compromise: the least sum of its objectives.

    Every objective is scaled to the extent of the non-dominated rows first, so units do not matter. Of two
    objectives that is the point farthest below the line through the front's ends (Das 1999); of more, the
    one nearest, by Manhattan distance, to the corner of all best values. The first of equally good rows
    wins. Raises ObjectiveError when no row is free of NaN.
    """
    table = _minimised(points, maximise)
    rows = np.flatnonzero(nondominated(table))
    if len(rows) == 0:
        raise ObjectiveError("no knee: every point is missing a value")
    front = table[rows]
    extent = np.ptp(front, axis=0)
    scaled = (front - front.min(axis=0)) / np.where(extent > 0, extent, 1.0)
    return int(rows[np.argmin(scaled.sum(axis=1))])


def choose(
    front: Sequence[tuple[Point, Mapping[str, float]]],
    limits: Mapping[str, float],
    prefer: str,
    maximise: Collection[str] = (),
) -> tuple[Point, Mapping[str, float]]:
    """Return the entry of `front` that is best in objective `prefer` among those within `limits`.

    `front` holds (anything, values by objective). A limit is an inclusive upper bound, or a lower one for
    the objectives in `maximise`. Ties go to the entry that is better in the limited objectives, in order.

    Raises NothingWithinLimitsError naming the nearest value, ObjectiveError for an objective that the front
    does not have.
    """
    if not front:
        raise NothingWithinLimitsError("nothing to choose from: the front is empty")
    for name in (prefer, *limits):
        if any(name not in values for _, values in front):
            raise ObjectiveError(
                f"objective {name!r} is not in this front, which has {', '.join(front[0][1])}"
            )

    def cost(values: Mapping[str, float], name: str) -> float:
        return -values[name] if name in maximise else values[name]

    def bound(name: str) -> float:
        return -limits[name] if name in maximise else limits[name]

    within = [entry for entry in front if all(cost(entry[1], name) <= bound(name) for name in limits)]
    if not within:
        for name, limit in limits.items():
            best = min((values for _, values in front), key=lambda values: cost(values, name))[name]
            if cost({name: best}, name) > bound(name):
                raise NothingWithinLimitsError(f"no point with {name} within {limit:g}: the best is {best:g}")
        raise NothingWithinLimitsError(f"no point keeps all of {dict(limits)}: loosen one of them")
    return min(within, key=lambda entry: [cost(entry[1], name) for name in (prefer, *limits)])


def _minimised(points: ArrayLike, maximise: Sequence[bool] | None) -> NDArray[np.float64]:
    table = np.asarray(points, dtype=np.float64)
    if table.ndim != 2 or table.shape[1] < 1:
        if table.size == 0:
            return np.empty((0, 1))
        raise ObjectiveError(f"points must be a table of rows and objectives, not of shape {table.shape}")
    return table if maximise is None else table * signs(maximise, table.shape[1])


def _not_ruled_out(
    columns: NDArray[np.float64], scale: Callable[[NDArray[np.float64]], NDArray[np.float64]]
) -> NDArray[np.int64]:
    """Return ascending positions of the rows that a coarse grid does not already rule out.

    A row is beaten when the least last objective, among all cells that are nearer in every other objective,
    is at most its own. That costs a few passes over the table and leaves little to sort, the expensive part
    of the filter. `scale` is any monotonic function; it affects how many rows are left, never the result.
    """
    axes = len(columns) - 1
    size = int(CELLS ** (1.0 / axes))
    cell = np.zeros(columns.shape[1], dtype=np.intp)
    for column in columns[:-1]:
        cell *= size
        cell += _cells(scale(column), size)
    least = np.full((size,) * axes, np.inf)
    np.minimum.at(least.reshape(-1), cell, columns[-1])
    for axis in range(axes):
        np.minimum.accumulate(least, axis=axis, out=least)
    nearer = np.full_like(least, np.nan)  # nothing precedes the first cells, and NaN never dominates
    nearer[(slice(1, None),) * axes] = least[(slice(None, -1),) * axes]
    nearer[np.isinf(nearer) & (nearer > 0)] = np.nan
    return np.flatnonzero(~(nearer.reshape(-1)[cell] <= columns[-1]))


def _cells(numbers: NDArray[np.float64], size: int) -> NDArray[np.intp]:
    """Return a cell in 0 .. size - 1 for each of the numbers: smaller numbers never in a higher cell."""
    low, high = numbers.min(), numbers.max()
    if math.isinf(low) or math.isinf(high):
        finite = numbers[np.isfinite(numbers)]
        low, high = (finite.min(), finite.max()) if len(finite) else (0.0, 0.0)
        numbers = np.clip(numbers, low, high)
    extent = float(high) - float(low)
    if extent == 0 or math.isinf(extent):
        return np.zeros(len(numbers), dtype=np.intp)
    cells: NDArray[np.intp] = np.minimum(((numbers - low) / extent * size).astype(np.intp), size - 1)
    return cells


def _ordinal(numbers: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return each number's rank among all floating-point numbers: about a logarithm, defined everywhere."""
    bits = np.ascontiguousarray(numbers).view(np.int64)
    # Negative numbers count downwards from minus zero, which shares its rank with zero.
    return np.where(bits < 0, np.iinfo(np.int64).min - bits, bits).astype(np.float64)


def _staircase(columns: NDArray[np.float64]) -> NDArray[np.bool_]:
    """The filter for one and two objectives: in order of the first, each new least second is on the front."""
    order = np.argsort(columns[0])
    x, y = columns[0, order], columns[-1, order]
    # Rows that share the first objective are neighbours: only the least of them can be on the front.
    starts = np.flatnonzero(np.concatenate([[True], x[1:] != x[:-1]]))
    least = np.minimum.reduceat(y, starts)
    step = np.concatenate([[True], least[1:] < np.minimum.accumulate(least)[:-1]])
    mask = np.empty(len(order), dtype=bool)
    mask[order] = np.repeat(np.where(step, least, np.nan), np.diff(starts, append=len(x))) == y
    return mask


def _by_blocks(columns: NDArray[np.float64]) -> NDArray[np.bool_]:
    """The filter for three objectives and more: in lexicographic order only earlier rows dominate later
    ones."""
    order = np.lexsort(columns[::-1])
    columns = columns[:, order]
    # Equal rows are neighbours now: decide for the first of each run and copy its answer to the others.
    first = np.concatenate([[True], (columns[:, 1:] != columns[:, :-1]).any(axis=0)])
    distinct = columns[1:, first]
    winning = np.zeros(distinct.shape[1], dtype=bool)
    earlier = _Staircase() if len(distinct) == 2 else _List(len(distinct))
    for start in range(0, len(winning), BLOCK):
        block = distinct[:, start : start + BLOCK]
        alive = np.flatnonzero(~earlier.weakly_dominates(block))
        block = block[:, alive]
        beaten = np.triu(np.ones((len(alive), len(alive)), dtype=bool), 1)  # [i, j]: i comes before j
        for column in block:
            beaten &= column[:, None] <= column
        winners = ~beaten.any(axis=0)
        winning[start + alive[winners]] = True
        earlier.add(block[:, winners])
    mask = np.empty(len(order), dtype=bool)
    mask[order] = winning[np.cumsum(first) - 1]
    return mask


class _Staircase:
    """The lower-left boundary of the (second, third) objectives seen so far."""

    def __init__(self) -> None:
        self.x = np.empty(0)
        self.lowest = np.empty(0)  # the least y among points with at most this x

    def weakly_dominates(self, block: NDArray[np.float64]) -> NDArray[np.bool_]:
        if len(self.x) == 0:
            return np.zeros(block.shape[1], dtype=bool)
        step = np.searchsorted(self.x, block[0], side="right") - 1
        dominated: NDArray[np.bool_] = (step >= 0) & (self.lowest[np.maximum(step, 0)] <= block[1])
        return dominated

    def add(self, block: NDArray[np.float64]) -> None:
        x = np.concatenate([self.x, block[0]])
        y = np.concatenate([self.lowest, block[1]])
        order = np.lexsort((y, x))
        x, lowest = x[order], np.minimum.accumulate(y[order])
        corner = np.concatenate([[True], lowest[1:] < lowest[:-1]])[: len(x)]
        self.x, self.lowest = x[corner], lowest[corner]


class _List:
    """All front rows so far, compared one block at a time: for four objectives and more."""

    def __init__(self, objectives: int) -> None:
        self.rows = np.empty((objectives, 0))

    def weakly_dominates(self, block: NDArray[np.float64]) -> NDArray[np.bool_]:
        beaten = np.zeros(block.shape[1], dtype=bool)
        for start in range(0, self.rows.shape[1], BLOCK):
            open_ = np.flatnonzero(~beaten)
            worse = np.ones((min(BLOCK, self.rows.shape[1] - start), len(open_)), dtype=bool)
            for row, column in zip(self.rows[:, start : start + BLOCK], block[:, open_], strict=True):
                worse &= row[:, None] <= column
            beaten[open_] = worse.any(axis=0)
        return beaten

    def add(self, block: NDArray[np.float64]) -> None:
        self.rows = np.concatenate([self.rows, block], axis=1)
