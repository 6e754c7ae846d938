"""The numbers that models learn from: minimised, on a log scale where possible, with a reference point."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pareto.fronts.front import nondominated
from pareto.search.history import History
from pareto.spaces.space import Indices

Array = NDArray[np.float64]

SLACK = 0.1  # of the front's extent, beyond its ends, where the user set no limit
WIDE_SLACK = 0.5  # while few points are known
FEW = 40  # points; the slack of more is the narrower, the more they are
TRADE = 0.05  # least gain in one objective for what is given up in another, in shares of the front's extent
NEAR = 0.1  # of the extent of front and reference: how far behind the front is still beside it
LEAST_NEAR = 60  # points count as near at least, if so many are in reach
REACH = 0.1  # of the room up to the reference, beyond it: how bad a value may be and still tell something
FLOOR = 0.05  # of a column's standard deviation: the least room that counts
TINY = 1e-9  # beside values of the order of one


@dataclass(frozen=True)
class Targets:
    """`values` (n, objectives) of the measured `indices`; improvement counts below `reference` only.

    `limits` are infinite where there are none. `front` numbers the rows that are non-dominated among those
    within the reference.
    """

    indices: Indices
    values: Array
    limits: Array
    reference: Array
    front: NDArray[np.int64]

    @classmethod
    def of(cls, history: History) -> Targets:
        """Read the history's successes: logarithms, or shares of the largest magnitude where there are none.

        Where the user set no limit, the reference lies beyond the part of the front that is worth its price;
        while nothing keeps the limits, they are what the nearest miss keeps. Raises ValueError when nothing
        succeeded.
        """
        indices, natural = history.measured()
        if len(indices) == 0:
            raise ValueError("nothing was measured yet")
        values = np.empty_like(natural)
        limits = np.full(natural.shape[1], np.inf)
        for column, objective in enumerate(history.objectives):
            limit = history.limits.get(objective.name)
            numbers = natural[:, column]
            if numbers.min() > 0 and (limit is None or limit > 0):
                values[:, column] = np.log(numbers) * objective.sign
                limit = limit and float(np.log(limit))
            else:
                unit = float(np.abs(numbers).max()) or 1.0
                values[:, column] = numbers / unit * objective.sign
                limit = None if limit is None else limit / unit
            if limit is not None:
                limits[column] = limit * objective.sign
        limits = _relaxed(limits, values)
        reference = _complete(limits, values)
        inside = np.flatnonzero((values <= reference).all(axis=1))
        return cls(indices, values, limits, reference, inside[nondominated(values[inside])])

    @property
    def floor(self) -> Array:
        """The least distance (objectives) below the reference that is worth telling apart."""
        return np.maximum(FLOOR * self.values.std(axis=0), TINY)

    @property
    def range(self) -> Array:
        """How far apart the (objectives) values are, or the `floor`."""
        return np.maximum(np.ptp(self.values, axis=0), self.floor)

    @property
    def worst(self) -> Array:
        """The (objectives) limits, and where there is none the largest value measured."""
        return np.where(np.isfinite(self.limits), self.limits, self.values.max(axis=0))

    @cached_property
    def whole_front(self) -> Array:
        """All (front, objectives) values that no other dominates, within the limits or not."""
        return self.values[nondominated(self.values)]

    @cached_property
    def depth(self) -> Array:
        """How far each of the n points must improve, in all objectives alike, before it would count.

        In shares of the extent of the front and the reference: it must get ahead of every point of the front
        in some objective, and keep the reference in all. Zero on the front.
        """
        front = self.values[self.front] if len(self.front) else self.reference[None]
        scale = np.maximum(np.ptp(np.vstack([front, self.reference]), axis=0), self.floor)
        behind = ((self.values[:, None] - front) / scale).min(axis=2).max(axis=1)
        beyond = ((self.values - self.reference) / scale).max(axis=1)
        return np.maximum.reduce([behind, beyond, np.zeros(len(behind))])

    def near(self) -> NDArray[np.bool_]:
        """Return which of the n points lie on the front or beside it: a quarter of them at least."""
        reached = int(self.within_reach().all(axis=1).sum())
        count = max(len(self.values) // 4, min(LEAST_NEAR, reached), 1)
        return self.depth <= max(NEAR, float(np.partition(self.depth, count - 1)[count - 1]))

    def winsorised(self) -> Array:
        """Return the values, those out of reach of the reference pulled in to where that ends.

        How bad a bad point is does not matter, and would bend smooth models where it does.
        """
        return np.minimum(self.values, self._reach())

    def within_reach(self) -> NDArray[np.bool_]:
        """Return which of the (n, objectives) values `winsorised` leaves as they are."""
        return self.values <= self._reach()

    def _reach(self) -> Array:
        """REACH of the room behind the reference, but always so that a quarter of the values lies within."""
        room = np.maximum(self.reference - self.values.min(axis=0), self.floor)
        return np.maximum(self.reference + REACH * room, np.quantile(self.values, 0.25, axis=0))


def _relaxed(limits: Array, values: Array) -> Array:
    """Return the limits; while nothing keeps them all, those that the nearest miss keeps.

    Improving on the nearest miss leads towards the limits, of which a model may know no more than that.
    """
    excess = np.maximum(values - limits, 0.0) / np.maximum(values.std(axis=0), TINY)
    nearest = values[np.argmin(excess.sum(axis=1))]
    return np.maximum(limits, nearest)


def _complete(limits: Array, values: Array) -> Array:
    """Fill in a reference for objectives without a limit: beyond the end of the front within the limits.

    A front ends where hardly anything is gained any more for what is given up, both in shares of its extent:
    where trade-offs are out of bounds (proper efficiency, Geoffrion 1968). One that goes on to where tracking
    is lost, for a percent of the time, would else be looked for mostly there.

    Whatever lies beyond the reference is worth nothing and will not be looked for, so that the slack is wide
    at first: a front that is found from its middle must be able to grow outwards. But the wider it is, the
    more a gain at either end counts, and the less one between; in the end it is the tenth of Ishibuchi et
    al. 2011. Where the front is a single point (one objective, or objectives that agree), it has no extent:
    the median of what was measured within the limits is then the least that the reference lets in.
    """
    inside = values[(values <= limits).all(axis=1)]
    front = inside[nondominated(inside)]
    shares = front / np.maximum(np.ptp(front, axis=0), TINY)
    front = front[nondominated(shares + TRADE * shares.sum(axis=1, keepdims=True))]
    low, high = front.min(axis=0), front.max(axis=0)
    slack = max(SLACK, WIDE_SLACK * min(1.0, FEW / len(inside)))
    ends = np.maximum(high + slack * np.maximum(high - low, TINY), np.median(inside, axis=0))
    return np.where(np.isfinite(limits), limits, ends)
