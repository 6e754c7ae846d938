"""The part of a space that its constraints allow: counting and numbering its points without enumerating it.

Parameters that no constraint links are independent, so the allowed part is a product of smaller sets. Each
set is tabulated: starting from one per parameter, those that a constraint links are joined and violations are
dropped, as long as no join is too large. The result is a product again, whose members are counted and drawn
exactly, even for tight constraints. A constraint that links too much to be tabulated stays open: draws from
the product are tested against it. Conditions are tabulated like constraints. Where they link too much, values
are drawn for inactive parameters, too, and the point is then folded to its representative.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pareto.spaces.constraint import Clause
from pareto.spaces.grid import CHUNK, Grid, Indices

LARGEST_JOIN = 2**22  # rows: 32 MiB of indices, and well below a second
DRAWS = 2**20  # for an estimate
HITS = 10_000  # for an accuracy of about 1 %
FIXED = 1000.0  # cost of a step of a parameter that should not move


@dataclass(frozen=True)
class Count:
    """A number of points, and the standard error of it where it is an estimate."""

    points: int
    error: int = 0

    @property
    def exact(self) -> bool:
        """Whether the points were counted rather than estimated."""
        return self.error == 0

    def __str__(self) -> str:
        return f"{self.points:,}" if self.exact else f"about {self.points:,} (+- {self.error:,})"


class Region:
    """The points of `space` that keep its constraints, as a product of factors and open clauses.

    A point's index is the sum of one offset from each of the `factors`; `open` are the clauses that remain.
    In a `folded` region the factors also hold values of inactive parameters: several members of the product
    are then one point. A region is folded where conditions cannot be tabulated, or on request.
    """

    def __init__(self, space: Grid, folded: bool = False) -> None:
        self.space = space
        self.folded = folded
        if not folded:
            self.factors, self.open = _smallest(space, space.clauses)
            conditions = {id(clause) for clause in space.condition_clauses}
            self.folded = any(id(clause) in conditions for clause in self.open)
        if self.folded:
            self.factors, self.open = _smallest(space, space.constraint_clauses)

    @cached_property
    def sizes(self) -> tuple[int, ...]:
        """The number of members of each factor."""
        return tuple(len(factor) for factor in self.factors)

    @cached_property
    def size(self) -> int:
        """The number of members of the product: all allowed points, and those that break open clauses only.

        A folded region has more members than points.
        """
        return math.prod(self.sizes)

    def join(self, rows: NDArray[np.integer]) -> Indices:
        """Return the indices of (n, factors) positions in the factors."""
        indices = np.zeros(len(rows), dtype=np.int64)
        for factor, column in zip(self.factors, rows.T, strict=True):
            indices += factor[column]
        return self.space.fold(indices) if self.folded else indices

    def at(self, ranks: Indices) -> Indices:
        """Return the indices of the product's members number `ranks`: distinct ones unless it is folded."""
        if not self.space.clauses:
            return ranks
        return self.join(np.stack(np.unravel_index(ranks, self.sizes), axis=-1))

    def keeps(self, indices: Indices) -> NDArray[np.bool_]:
        """Return which points of the product keep the open clauses too."""
        return self.space.evaluate(self.open, indices)

    @cached_property
    def count(self) -> Count:
        """The number of allowed points: exact where all is tabulated, else estimated by drawing."""
        if not self.size or not (self.open or self.folded):
            return Count(self.size)
        drawn = hits = 0
        total = squares = 0.0
        for kept in self._drawn():
            drawn, hits = drawn + CHUNK, hits + len(kept)
            # A point that m members are folded to is drawn m times as often as another one.
            shares = 1 / self.space.multiplicity(kept) if self.folded else np.ones(len(kept))
            total, squares = total + shares.sum(), squares + (shares**2).sum()
            if hits >= HITS and not self.folded:
                break
        share = total / drawn
        error = math.sqrt(max(squares / drawn - share**2, 1 / drawn) / drawn)
        return Count(round(self.size * share), math.ceil(self.size * error))

    def nearest(self, index: int, movable: Collection[str]) -> int | None:
        """Return an allowed point near `index`, or None where none is found.

        Nearest in the sum over parameters of the steps between values as a share of their range, where
        parameters that are not `movable` weigh far more; among some drawn points only where a clause is open.
        """
        space = self.space
        ranges = np.maximum(np.array(space.shape) - 1, 1)
        weights = np.array([1.0 if name in movable else FIXED for name in space.names]) / ranges
        [codes] = space.codes([index])

        def closest(indices: Indices) -> int:
            # Parameters outside a factor have code 0 in all of its offsets: a constant that changes no order.
            return int(np.argmin((np.abs(space.codes(indices) - codes) * weights).sum(axis=1)))

        if not self.size:
            return None
        points = self.join(np.array([[closest(factor) for factor in self.factors]]))
        if not self.keeps(points).all():
            points = max(self._drawn(), key=len)
        return int(points[closest(points)]) if len(points) else None

    def _drawn(self) -> Iterator[Indices]:
        """Draw CHUNK points of the product at a time, DRAWS in all, and yield those that are allowed."""
        rng = np.random.default_rng(0)
        for _ in range(0, DRAWS, CHUNK):
            indices = self.at(rng.integers(0, self.size, size=CHUNK))
            yield indices[self.keeps(indices)]


def _smallest(space: Grid, clauses: Sequence[Clause]) -> tuple[list[Indices], list[Clause]]:
    """Return factors and open clauses, of the two orders of joining those with fewer open clauses."""
    factors, still_open = _tabulated(space, clauses, largest_first=False)
    if still_open:
        # A large join that drops nearly everything may make the others small.
        others, left = _tabulated(space, clauses, largest_first=True)
        if len(left) < len(still_open):
            return others, left
    return factors, still_open


def _tabulated(
    space: Grid, clauses: Sequence[Clause], largest_first: bool
) -> tuple[list[Indices], list[Clause]]:
    """Return the factors, joined as far as LARGEST_JOIN allows, and the clauses that remain open."""
    factors = [
        np.arange(size, dtype=np.int64) * stride
        for size, stride in zip(space.shape, space.strides, strict=True)
    ]
    members = [{name} for name in space.names]
    left = list(clauses)
    while True:
        joins = []
        for clause in left:
            linked = [i for i, names in enumerate(members) if names & set(clause.names)]
            size = math.prod(len(factors[i]) for i in linked)
            if size <= LARGEST_JOIN:
                # A clause within one factor makes it smaller at no cost.
                joins.append((len(linked) > 1, -size if largest_first else size, clause, linked))
        if not joins:
            return factors, left
        _, _, clause, linked = min(joins, key=lambda join: join[:2])
        left.remove(clause)
        joined = np.sort(_sums([factors[i] for i in linked]))
        factors[linked[0]] = joined[space.evaluate([clause], joined)]
        for i in reversed(linked[1:]):
            members[linked[0]] |= members.pop(i)
            del factors[i]


def _sums(factors: Sequence[Indices]) -> Indices:
    sums = np.zeros(1, dtype=np.int64)
    for factor in factors:
        sums = (sums[:, None] + factor).ravel()
    return sums
