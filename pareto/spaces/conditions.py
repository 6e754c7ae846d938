"""Conditional parameters: which ones are active in a configuration, and the values of the others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from pareto.errors import ConstraintError
from pareto.spaces.constraint import Clause, Codes, Constraint
from pareto.spaces.parameter import Parameter

Mask = NDArray[np.bool_]


class Conditions:
    """The conditions of `parameters`: a parameter is active while its condition holds.

    It is inactive, too, while a parameter that its condition mentions is inactive; of alternatives that `or`
    joins, one that holds is enough, whatever parameters the others mention. An inactive parameter has
    one position, that of its default, so that configurations which differ only in it are the same point.

    Raises ConstraintError for a condition that cannot be read, or that depends on its own parameter.
    """

    def __init__(self, parameters: Sequence[Parameter]) -> None:
        self.parameters = tuple(parameters)
        self._conditions = {
            item.name: Constraint(item.condition, self.parameters, f"condition of {item.name!r}")
            for item in self.parameters
            if item.condition is not None
        }
        self._canonical = {
            item.name: item.encode(item.default) for item in self.parameters if item.name in self._conditions
        }
        self._deciding: dict[str, tuple[str, ...]] = {}
        for name in self._conditions:
            self._decide(name, ())

    def __bool__(self) -> bool:
        """Whether any parameter has a condition."""
        return bool(self._conditions)

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters that have a condition, in order."""
        return tuple(self._conditions)

    def parents(self, name: str) -> tuple[str, ...]:
        """The parameters that the condition of `name` mentions."""
        return self._conditions[name].names if name in self._conditions else ()

    @property
    def choice(self) -> Parameter | None:
        """The first categorical parameter that decides whether others are active, such as an algorithm."""
        deciding = {name for names in self._deciding.values() for name in names}
        kinds = (item for item in self.parameters if item.type == "categorical" and item.name in deciding)
        return next(kinds, None)

    def active(self, codes: Codes) -> dict[str, Mask]:
        """Return for each conditional parameter where it is active; `codes` has the positions of all."""
        masks: dict[str, Mask] = {}
        for name in self._conditions:
            self._activate(name, codes, masks)
        return masks

    def fold(self, indices: NDArray[np.int64], strides: Mapping[str, tuple[int, int]]) -> NDArray[np.int64]:
        """Return `indices` with every inactive parameter at its one position.

        `strides` has (stride, number of values) of each parameter.
        """
        if not self:
            return indices
        codes = {name: indices // stride % size for name, (stride, size) in strides.items()}
        folded = indices.copy()
        for name, mask in self.active(codes).items():
            folded += np.where(mask, 0, (self._canonical[name] - codes[name]) * strides[name][0])
        return folded

    def multiplicity(
        self, indices: NDArray[np.int64], strides: Mapping[str, tuple[int, int]]
    ) -> NDArray[np.float64]:
        """Return how many combinations of values are folded to each of `indices`."""
        codes = {name: indices // stride % size for name, (stride, size) in strides.items()}
        many = np.ones(len(indices))
        for name, mask in self.active(codes).items():
            many *= np.where(mask, 1, strides[name][1])
        return many

    def clauses(self) -> tuple[Clause, ...]:
        """Return the constraints of a folded point: each parameter is active, or at its one position."""
        return tuple(self._clause(name) for name in self._conditions)

    def constraint(self, text: str) -> Constraint:
        """Return a constraint that does not apply while a parameter that it mentions is inactive."""
        constraint = Constraint(text, self.parameters)
        constraint.clauses = tuple(self._relaxed(clause) for clause in constraint.clauses)
        return constraint

    def _decide(self, name: str, above: tuple[str, ...]) -> tuple[str, ...]:
        """Return all parameters on which it depends whether `name` is active, nearest first."""
        if name in above:
            circle = " -> ".join([*above[above.index(name) :], name])
            raise ConstraintError(
                f"the condition of {name!r} depends on {name!r} itself ({circle}): a condition may mention "
                "only parameters that do not depend on this one"
            )
        if name not in self._deciding and name in self._conditions:
            direct = self._conditions[name].names
            further = [other for parent in direct for other in self._decide(parent, (*above, name))]
            self._deciding[name] = tuple(dict.fromkeys([*direct, *further]))
        return self._deciding.get(name, ())

    def _activate(self, name: str, codes: Codes, masks: dict[str, Mask]) -> Mask:
        if name not in masks:
            alternatives = self._conditions[name].alternatives
            masks[name] = reduce(
                np.logical_or, (self._all_hold(clauses, codes, masks) for clauses in alternatives)
            )
        return masks[name]

    def _all_hold(self, clauses: Sequence[Clause], codes: Codes, masks: dict[str, Mask]) -> Mask:
        """Return where all clauses hold and all parameters that they mention are active."""
        mask = np.asarray(True)
        for clause in clauses:
            mask = mask & clause.holds(codes)
            for parent in clause.names:
                if parent in self._conditions:
                    mask = mask & self._activate(parent, codes, masks)
        return mask

    def _clause(self, name: str) -> Clause:
        position = self._canonical[name]
        return Clause(
            (name, *self._deciding[name]),
            lambda codes: self._activate(name, codes, {}) | (codes[name] == position),
        )

    def _relaxed(self, clause: Clause) -> Clause:
        conditional = [name for name in clause.names if name in self._conditions]
        if not conditional:
            return clause
        deciding = [other for name in conditional for other in self._deciding[name]]

        def holds(codes: Codes) -> Mask:
            masks: dict[str, Mask] = {}
            kept = clause.holds(codes)
            for name in conditional:
                kept = kept | ~self._activate(name, codes, masks)
            return kept

        return Clause(tuple(dict.fromkeys([*clause.names, *deciding])), holds)
