"""The product of finitely many parameters, indexed by one integer, and the clauses of its allowed points."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pareto.errors import SpaceError
from pareto.spaces.conditions import Conditions
from pareto.spaces.constraint import Clause, Codes
from pareto.spaces.parameter import Parameter
from pareto.spaces.user_prior import value_weights
from pareto.spaces.value_ranges import COARSEST, FINEST

Indices = NDArray[np.int64]

LARGEST = 2**62  # indices are int64, and sums of two of them must not overflow
CHUNK = 2**16  # points evaluated at once, whose columns the cache holds


class Grid:
    """All points of the product of `parameters`, by index: the first parameter varies slowest.

    An allowed point keeps the clauses of constraints and those of conditions. Raises SpaceError without
    parameters, for two of one name, and for too many points.
    """

    conditions: Conditions
    constraint_clauses: tuple[Clause, ...]
    condition_clauses: tuple[Clause, ...]

    def __init__(self, parameters: Sequence[Parameter]) -> None:
        self.parameters = _with_levels(parameters)
        if not self.parameters:
            raise SpaceError("a space needs at least one parameter")
        if len(set(self.names)) != len(self.names):
            raise SpaceError(f"parameter names must differ: {list(self.names)}")
        self.shape = tuple(len(parameter.values) for parameter in self.parameters)
        if math.prod(self.shape) > LARGEST:
            raise SpaceError(
                f"{math.prod(self.shape):.1e} points are too many: at most 2**62, use coarser values"
            )
        self.strides = tuple(math.prod(self.shape[axis + 1 :]) for axis in range(len(self.shape)))

    def __len__(self) -> int:
        return math.prod(self.shape)

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters' names, in order."""
        return tuple(parameter.name for parameter in self.parameters)

    @property
    def clauses(self) -> tuple[Clause, ...]:
        """The clauses that an allowed point keeps."""
        return (*self.constraint_clauses, *self.condition_clauses)

    def codes(self, indices: Iterable[int] | Indices) -> NDArray[np.int64]:
        """Return (n, parameters) value positions of `indices`."""
        flat = np.asarray(indices if isinstance(indices, np.ndarray) else list(indices), dtype=np.int64)
        return np.stack(np.unravel_index(flat, self.shape), axis=-1).astype(np.int64, copy=False)

    def fold(self, indices: Indices) -> Indices:
        """Return `indices` with inactive parameters at their default: equal ones are the same point."""
        return self.conditions.fold(indices, self._strides)

    def multiplicity(self, indices: Indices) -> NDArray[np.float64]:
        """Return how many indices are folded to the same point as each of `indices`."""
        return self.conditions.multiplicity(indices, self._strides)

    def weights(self, indices: Indices) -> NDArray[np.float64]:
        """Return the product of the user's weights of each point's values: 1 without any prior."""
        weights = np.ones(len(indices))
        for name, table in self.value_weights.items():
            stride, size = self._strides[name]
            weights *= table[indices // stride % size]
        return weights

    @cached_property
    def value_weights(self) -> dict[str, NDArray[np.float64]]:
        """The weights of the values of each parameter that has a prior."""
        return {item.name: value_weights(item.prior, item.values) for item in self.parameters if item.prior}

    def evaluate(self, clauses: Sequence[Clause], indices: Indices) -> NDArray[np.bool_]:
        """Return which `indices` keep all `clauses`, a chunk at a time."""
        mask = np.ones(len(indices), dtype=bool)
        names = {name for clause in clauses for name in clause.names}
        axes = [(name, axis) for axis, name in enumerate(self.names) if name in names]
        for start in range(0, len(indices) if clauses else 0, CHUNK):
            chunk = indices[start : start + CHUNK]
            codes: Codes = {name: chunk // self.strides[axis] % self.shape[axis] for name, axis in axes}
            for clause in clauses:
                mask[start : start + CHUNK] &= clause.holds(codes)
        return mask

    @cached_property
    def _strides(self) -> dict[str, tuple[int, int]]:
        return dict(zip(self.names, zip(self.strides, self.shape, strict=True), strict=True))


def _with_levels(parameters: Sequence[Parameter]) -> tuple[Parameter, ...]:
    """Return `parameters`, those of any value with as many levels as leave room for all.

    That is 2**FINEST, or a smaller power of two, at least 2**COARSEST, where the product would be too large.
    """
    listed = math.prod(len(item.values) for item in parameters if not item.levels)
    free = sum(item.levels is not None for item in parameters)
    bits = next((n for n in range(FINEST, COARSEST, -1) if listed << n * free <= LARGEST), COARSEST)
    return tuple(
        replace(item, values=replace(item.levels, size=2**bits)) if item.levels else item
        for item in parameters
    )
