"""The part of a space that its constraints allow: its size, and its points by number, without enumerating it.

Parameters that no constraint links are independent, so the allowed part is a product of smaller sets. Each
set is tabulated: starting from one a parameter, those that a constraint links are joined and what breaks it
is dropped, the smallest join first, as long as a join is not too large. What is left is a product again,
whose members are counted and drawn exactly however tight the constraints are. A constraint that links too
much to be tabulated stays open: draws from the product are tested against it.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pareto.constraint import Clause, Codes

if TYPE_CHECKING:
    from pareto.space import Indices, Space

LARGEST_JOIN = 2**22  # rows: 32 MiB of indices, and well below a second
CHUNK = 2**16  # points evaluated at once, whose columns the cache holds
DRAWS = 2**22  # for an estimate, and at a time
HITS = 10_000  # which bound an estimate to about 1 %
FIXED = 1000.0  # what a step of a parameter costs that should stay as it is


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
    """The points of `space` that keep its constraints, as a product of factors and what must be tested.

    A point's index is the sum of one offset from each of the `factors`; `open` are the clauses that remain.
    """

    def __init__(self, space: Space) -> None:
        self.space = space
        self.factors: list[Indices] = [
            np.arange(size, dtype=np.int64) * stride
            for size, stride in zip(space.shape, space.strides, strict=True)
        ]
        members = [{name} for name in space.names]
        self.open = [clause for constraint in space.constraints for clause in constraint.clauses]
        while self.open:
            links = [[i for i, names in enumerate(members) if names & set(c.names)] for c in self.open]
            sizes = [math.prod(len(self.factors[i]) for i in linked) for linked in links]
            cheapest = int(np.argmin(np.array(sizes, dtype=np.float64)))
            if sizes[cheapest] > LARGEST_JOIN:
                break
            clause, linked = self.open.pop(cheapest), links[cheapest]
            joined = np.sort(_sums([self.factors[i] for i in linked]))
            kept = joined[evaluate(space, [clause], joined)]
            for i in reversed(linked[1:]):
                members[linked[0]] |= members.pop(i)
                del self.factors[i]
            self.factors[linked[0]] = kept

    @cached_property
    def sizes(self) -> tuple[int, ...]:
        """How many members each factor has."""
        return tuple(len(factor) for factor in self.factors)

    @cached_property
    def size(self) -> int:
        """How many points the product has: all allowed ones, and those that break open clauses only."""
        return math.prod(self.sizes)

    def join(self, rows: NDArray[np.integer]) -> Indices:
        """Return the indices of (n, factors) positions in the factors."""
        indices = np.zeros(len(rows), dtype=np.int64)
        for factor, column in zip(self.factors, rows.T, strict=True):
            indices += factor[column]
        return indices

    def at(self, ranks: Indices) -> Indices:
        """Return the indices of the product's points number `ranks`: distinct ones of distinct ranks."""
        if not self.space.constraints:
            return ranks
        return self.join(np.stack(np.unravel_index(ranks, self.sizes), axis=-1))

    def keeps(self, indices: Indices) -> NDArray[np.bool_]:
        """Return which points of the product keep the open clauses too."""
        return evaluate(self.space, self.open, indices)

    @cached_property
    def count(self) -> Count:
        """The number of allowed points: exact unless a clause is open, else estimated by drawing."""
        if not self.open or not self.size:
            return Count(self.size)
        rng, drawn, hits = np.random.default_rng(0), 0, 0
        while drawn < DRAWS and hits < HITS:
            ranks = rng.integers(0, self.size, size=CHUNK)
            hits += int(self.keeps(self.at(ranks)).sum())
            drawn += CHUNK
        share = hits / drawn
        error = math.sqrt(max(share * (1 - share), 1 / drawn) / drawn)
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
        found = self.join(np.array([[closest(factor) for factor in self.factors]]))
        if not self.keeps(found).all():
            drawn = self.at(np.random.default_rng(0).integers(0, self.size, size=DRAWS // 4))
            found = drawn[self.keeps(drawn)]
        return int(found[closest(found)]) if len(found) else None


def evaluate(space: Space, clauses: Sequence[Clause], indices: Indices) -> NDArray[np.bool_]:
    """Return which `indices` keep all `clauses`, a chunk at a time."""
    mask = np.ones(len(indices), dtype=bool)
    names = {name for clause in clauses for name in clause.names}
    axes = [(name, axis) for axis, name in enumerate(space.names) if name in names]
    for start in range(0, len(indices) if clauses else 0, CHUNK):
        chunk = indices[start : start + CHUNK]
        codes: Codes = {name: chunk // space.strides[axis] % space.shape[axis] for name, axis in axes}
        for clause in clauses:
            mask[start : start + CHUNK] &= clause.holds(codes)
    return mask


def _sums(factors: Sequence[Indices]) -> Indices:
    sums = np.zeros(1, dtype=np.int64)
    for factor in factors:
        sums = (sums[:, None] + factor).ravel()
    return sums
