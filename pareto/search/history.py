"""The history of an exploration: proposals, results, and pending measurements."""

from __future__ import annotations

from collections.abc import KeysView, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from pareto.fronts.censored import Censored
from pareto.fronts.front import nondominated
from pareto.fronts.objective import Objective
from pareto.spaces.grid import Indices
from pareto.spaces.space import Space

Values = tuple[float, ...]


class History:
    """Measured values by index, in the order they first arrived, and the indices still pending.

    A configuration may be measured more than once: its value is the mean of its successful measurements,
    and it counts as failed only while all of them failed. Where one of its values is Censored, the mean of
    them is a bound, and so censored, too.

    `rounds` are values of one configuration that is measured in each round of another program, to compare
    the others with it. They tell the noise, and count as measurements of no configuration.
    """

    def __init__(self, space: Space, objectives: tuple[Objective, ...], limits: Mapping[str, float]) -> None:
        self.space = space
        self.objectives = objectives
        self.limits = dict(limits)
        self.results: dict[int, list[Values | None]] = {}
        self.phases: dict[int, str] = {}
        self.pending: list[tuple[int, str]] = []
        self.rounds: list[Values] | None = None

    def expect(self, index: int, phase: str) -> None:
        """Mark `index` as pending; one that is measured again may be pending twice."""
        self.pending.append((index, phase))

    def withdraw(self, index: int) -> str | None:
        """Remove the oldest pending proposal of `index`, and return its phase; None where there is none."""
        for number, (waiting, phase) in enumerate(self.pending):
            if waiting == index:
                del self.pending[number]
                return phase
        return None

    def record(self, index: int, values: Values | None, phase: str = "told") -> None:
        """Record a measurement, or a failed one; `phase` is its origin if it was not proposed."""
        proposed = self.withdraw(index)
        self.phases.setdefault(index, proposed or phase)
        self.results.setdefault(index, []).append(values)

    def waiting(self) -> KeysView[int]:
        """Return every pending index, in order."""
        return dict(self.pending).keys()

    @property
    def measurements(self) -> int:
        """The number of measurements, including failed ones."""
        return sum(map(len, self.results.values()))

    def taken(self) -> set[int]:
        """Return every index with results or pending."""
        return self.results.keys() | self.waiting()

    def measured(self) -> tuple[Indices, NDArray[np.float64]]:
        """Return (n,) indices and (n, objectives) mean values of successes, in order of arrival."""
        rows = [(index, [v for v in values if v is not None]) for index, values in self.results.items()]
        rows = [(index, values) for index, values in rows if values]
        # Most points are measured once, and np.mean of one value is slow.
        means = [values[0] if len(values) == 1 else mean(values) for _, values in rows]
        table = np.array(means, dtype=np.float64)
        indices = np.array([index for index, _ in rows], dtype=np.int64)
        return indices, table.reshape(len(rows), len(self.objectives))

    def censored(self) -> NDArray[np.bool_]:
        """Return an (n, objectives) mask of what is only a bound in the rows of `measured`."""
        rows = [[v for v in values if v is not None] for values in self.results.values()]
        masks = [
            [any(isinstance(value, Censored) for value in column) for column in zip(*values, strict=True)]
            for values in rows
            if values
        ]
        return np.array(masks, dtype=np.bool_).reshape(len(masks), len(self.objectives))

    def exact(self) -> NDArray[np.bool_]:
        """Return which (n) rows of `measured` have no censored value."""
        return np.asarray(~self.censored().any(axis=1))

    def repeats(self) -> list[list[Values]]:
        """Return the measurements without a censored value, of each configuration that has two or more.

        So are those of `rounds`. A bound says nothing about the difference of two measurements.
        """
        groups: list[Sequence[Values | None]] = [*self.results.values(), self.rounds or []]
        exact = (
            [v for v in values if v is not None and not any(isinstance(value, Censored) for value in v)]
            for values in groups
            if len(values) > 1
        )
        return [values for values in exact if len(values) > 1]

    def successes(self) -> NDArray[np.float64]:
        """Return (m, objectives) values of every single measurement that succeeded."""
        rows = [value for values in self.results.values() for value in values if value is not None]
        return np.array(rows, dtype=np.float64).reshape(len(rows), len(self.objectives))

    def counts(self) -> NDArray[np.int64]:
        """Return the (n) numbers of successful measurements of each row of `measured`."""
        counts = [sum(value is not None for value in values) for values in self.results.values()]
        return np.array([count for count in counts if count], dtype=np.int64)

    def attempts(self) -> NDArray[np.int64]:
        """Return `counts` with the failed measurements of the same configurations."""
        attempts = [len(values) for values in self.results.values() if any(values)]
        return np.array(attempts, dtype=np.int64)

    def failed(self) -> Indices:
        """Return the indices of which every measurement failed, in order of arrival."""
        return np.array([i for i, values in self.results.items() if not any(values)], dtype=np.int64)

    def within_limits(self, values: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return a mask of the rows of (n, objectives) natural values that keep all limits."""
        mask = np.ones(len(values), dtype=bool)
        for column, objective in enumerate(self.objectives):
            if objective.name in self.limits:
                limit = self.limits[objective.name]
                mask &= values[:, column] * objective.sign <= limit * objective.sign
        return mask

    def front(self) -> tuple[Indices, NDArray[np.float64]]:
        """Return indices and values of the non-dominated points within limits, by the first objective."""
        indices, values = self.measured()
        rows = self.front_rows(values)
        return indices[rows], values[rows]

    def front_rows(self, values: NDArray[np.float64]) -> Indices:
        """Return the rows of `measured` that are non-dominated within limits by `values`, by the first.

        A row with a censored value is never among them.
        """
        rows = np.flatnonzero(self.within_limits(values) & self.exact())
        rows = rows[nondominated(values[rows], [objective.maximise for objective in self.objectives])]
        signs = [objective.sign for objective in self.objectives]
        return rows[np.lexsort((values[rows] * signs).T[::-1])]


def mean(measurements: Sequence[Values]) -> NDArray[np.float64]:
    """Return the (objectives) means. Equal values have exactly that value as mean."""
    table = np.array(measurements)
    means: NDArray[np.float64] = table[0] + (table / len(table) - table[0] / len(table)).sum(axis=0)
    return means
