"""The numbers that models learn from: minimised, on a log scale where possible, with a reference point."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pareto.fronts.front import nondominated
from pareto.fronts.objective import Objective
from pareto.search.history import History
from pareto.spaces.grid import Indices

Array = NDArray[np.float64]

FEW = 40  # successes of the first design, and the least number of near points
MARGIN = 0.1  # of a front's extent: points so close behind it, or beyond its ends, still matter
WIDE_MARGIN = 0.5  # of the ends while few points are known: a front found from its middle must grow outwards
TRADE = 0.05  # least gain in one objective per loss in another, in shares of the front's extent
TINY = 1e-9  # relative to values of the order of one


@dataclass(frozen=True)
class Scale:
    """The transform of natural values to targets: logarithms or shares of a unit, times a sign."""

    log: NDArray[np.bool_]
    unit: Array
    sign: Array

    @classmethod
    def of(cls, natural: Array, objectives: tuple[Objective, ...], limits: Mapping[str, float]) -> Scale:
        """Take logarithms where all (n, objectives) measurements and the limit are positive."""
        bounds = np.array([limits.get(objective.name, 1.0) for objective in objectives])
        log = (natural.min(axis=0) > 0) & (bounds > 0)
        largest = np.abs(natural).max(axis=0)
        unit = np.where(log | (largest == 0), 1.0, largest)
        return cls(log, unit, np.array([float(objective.sign) for objective in objectives]))

    def targets(self, natural: Array) -> Array:
        """Return (n, objectives) targets of natural values."""
        values = natural / self.unit
        values[:, self.log] = np.log(values[:, self.log])
        return values * self.sign

    def natural(self, targets: Array) -> Array:
        """Return (n, objectives) natural values of targets."""
        values = targets * self.sign
        values[:, self.log] = np.exp(values[:, self.log])
        return values * self.unit


@dataclass(frozen=True)
class Targets:
    """`values` (n, objectives) of the measured `indices`; improvement counts below `reference` only.

    Where `censored` (n, objectives), a value is a bound: the true one is that or larger. `limits` are
    infinite where there are none. `front` numbers the rows that are non-dominated among those within the
    reference, none of them censored.
    """

    scale: Scale
    indices: Indices
    values: Array
    censored: NDArray[np.bool_]
    limits: Array
    reference: Array
    front: NDArray[np.int64]

    @classmethod
    def of(cls, history: History) -> Targets:
        """Read the history's successes: logarithms, or shares of the largest magnitude where there are none.

        Where the user set no limit, the reference lies beyond the useful part of the front. While nothing
        keeps the limits, they are relaxed to the nearest miss. Censored rows count for neither unless all
        rows are censored. Raises ValueError when nothing succeeded.
        """
        indices, natural = history.measured()
        if len(indices) == 0:
            raise ValueError("nothing was measured yet")
        scale = Scale.of(history.successes(), history.objectives, history.limits)
        values = scale.targets(natural)
        given = np.array([[history.limits.get(item.name, np.nan) for item in history.objectives]])
        bounds = scale.targets(given)[0]
        # Values are of the order of one: a limit a thousand million times as far has no effect.
        bounds[np.isnan(bounds) | (bounds > 1 / TINY)] = np.inf
        censored = history.censored()
        exact = history.exact()
        known = values[exact] if exact.any() else values
        limits = _relaxed(np.maximum(bounds, -1 / TINY), known)
        reference = _complete(limits, known)
        front = _front_rows(values, exact, reference)
        return cls(scale, indices, values, censored, limits, reference, front)

    @cached_property
    def exact(self) -> NDArray[np.bool_]:
        """Which of the n rows have no censored value."""
        return np.asarray(~self.censored.any(axis=1))

    def front_of(self, values: Array) -> NDArray[np.int64]:
        """Return the rows on the front by other (n, objectives) values, such as the means of models."""
        return _front_rows(values, self.exact, self.reference)

    @property
    def floor(self) -> Array:
        """The least relevant distance (objectives) below the reference."""
        floor: Array = np.maximum(TRADE * self.values.std(axis=0), TINY)
        return floor

    @property
    def worst(self) -> Array:
        """The (objectives) limits, or else the largest value measured."""
        return np.where(np.isfinite(self.limits), self.limits, self.values.max(axis=0))

    @cached_property
    def whole_front(self) -> Array:
        """All (front, objectives) values that no other dominates, within the limits or not; none censored."""
        measured = self.values[self.exact]
        return measured[nondominated(measured)]

    def near(self) -> NDArray[np.bool_]:
        """Return which of the n points lie on or near the front: a quarter of them at least.

        Censored ones never do, since their distance is unknown; so there may be fewer than a quarter.
        """
        depth = self.depth[self.exact]
        if not len(depth):
            return self.exact
        reached = int((self._within_reach().all(axis=1) & self.exact).sum())
        count = min(max(len(self.values) // 4, min(FEW, reached), 1), len(depth))
        return self.exact & (self.depth <= max(MARGIN, float(np.partition(depth, count - 1)[count - 1])))

    @cached_property
    def depth(self) -> Array:
        """The least improvement of each of the n points, equal in all objectives, before it would count.

        In shares of the extent of the front and the reference: it must get ahead of every point of the front
        in some objective, and keep the reference in all. Zero on the front. Of a censored point it is a lower
        bound.
        """
        front = self.values[self.front] if len(self.front) else self.reference[None]
        scale = np.maximum(np.ptp(np.vstack([front, self.reference]), axis=0), self.floor)
        behind = ((self.values[:, None] - front) / scale).min(axis=2).max(axis=1)
        beyond = ((self.values - self.reference) / scale).max(axis=1)
        depth: Array = np.maximum.reduce([behind, beyond, np.zeros(len(behind))])
        return depth

    def winsorised(self) -> Array:
        """Return the values, winsorised at a margin beyond the reference.

        The exact value of a bad point does not matter, and would distort smooth models near the front.
        """
        return np.minimum(self.values, self.reach)

    def _within_reach(self) -> NDArray[np.bool_]:
        return self.values <= self.reach

    @cached_property
    def reach(self) -> Array:
        """MARGIN of the room behind the reference, but always so that a quarter of the values lies within."""
        room = np.maximum(self.reference - self.values.min(axis=0), self.floor)
        reach: Array = np.maximum(self.reference + MARGIN * room, np.quantile(self.values, 0.25, axis=0))
        return reach


def _front_rows(values: Array, exact: NDArray[np.bool_], reference: Array) -> NDArray[np.int64]:
    """Return which of the `exact` rows of (n, objectives) values are on their front within the reference."""
    inside = np.flatnonzero((values <= reference).all(axis=1) & exact)
    return inside[nondominated(values[inside])]


def _relaxed(limits: Array, values: Array) -> Array:
    """Return the limits; while nothing keeps them all, those that the nearest miss keeps.

    Improving on the nearest miss leads towards the limits.
    """
    excess = np.maximum(values - limits, 0.0) / np.maximum(values.std(axis=0), TINY)
    nearest = values[np.argmin(excess.sum(axis=1))]
    relaxed: Array = np.maximum(limits, nearest)
    return relaxed


def _complete(limits: Array, values: Array) -> Array:
    """Fill in a reference for objectives without a limit: beyond the end of the front within the limits.

    A front ends where the gain per loss becomes tiny, both in shares of its extent: where trade-offs are out
    of bounds (proper efficiency, Geoffrion 1968). Otherwise the search would concentrate on an end where
    tracking is lost for a gain of a percent of the time.

    Points beyond the reference have no value and are not searched for, so the margin is wide at first. But a
    wide margin favours gains at the ends over those between; finally it is the tenth of Ishibuchi et al.
    2011. Where the front is a single point (one objective, or objectives that agree), it has no extent: the
    median of what was measured within the limits is then the least that the reference lets in.
    """
    inside = values[(values <= limits).all(axis=1)]
    front = inside[nondominated(inside)]
    shares = front / np.maximum(np.ptp(front, axis=0), TINY)
    front = front[nondominated(shares + TRADE * shares.sum(axis=1, keepdims=True))]
    low, high = front.min(axis=0), front.max(axis=0)
    margin = max(MARGIN, WIDE_MARGIN * min(1.0, FEW / len(inside)))
    ends = np.maximum(high + margin * np.maximum(high - low, TINY), np.median(inside, axis=0))
    return np.where(np.isfinite(limits), limits, ends)
