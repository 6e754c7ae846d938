"""The measurements in order of arrival, including failures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pareto.fronts.front import nondominated
from pareto.plot.style import text
from pareto.search.explorer import Explorer
from pareto.search.recommendation import Estimates
from pareto.spaces.grid import Indices
from pareto.spaces.parameter import Parameter


@dataclass(frozen=True)
class Arrivals:
    """(n,) `indices`, (n, objectives) mean `values`, and (n,) `phases`. Values are NaN for failures
    and where one of them is censored: pictures show values, not bounds. `estimates` holds the expected values
    of successes.
    """

    explorer: Explorer
    indices: Indices
    values: NDArray[np.float64]
    phases: NDArray[np.str_]
    estimates: Estimates

    @classmethod
    def of(cls, explorer: Explorer) -> Arrivals:
        """Read an explorer's history."""
        history = explorer.history
        indices = np.array(list(history.results), dtype=np.int64)
        values = np.full((len(indices), len(explorer.objectives)), np.nan)
        measured, means = history.measured()
        row_of = {index: row for row, index in enumerate(indices.tolist())}
        exact = history.exact()
        values[[row_of[index] for index in measured[exact].tolist()]] = means[exact]
        phases = np.array([history.phases[index] for index in indices.tolist()], dtype=np.str_)
        return cls(explorer, indices, values, phases, explorer.estimates())

    @property
    def succeeded(self) -> NDArray[np.bool_]:
        """(n,) whether the values are known."""
        return np.asarray(np.isfinite(self.values).all(axis=1))

    @property
    def names(self) -> list[str]:
        """The objectives' names."""
        return [objective.name for objective in self.explorer.objectives]

    @property
    def maximise(self) -> list[bool]:
        """Which objectives are maximised."""
        return [objective.maximise for objective in self.explorer.objectives]

    @property
    def limits(self) -> list[float | None]:
        """The limit of each objective, None where there is none."""
        return [self.explorer.limits.get(name) for name in self.names]

    def front(self, first: int, second: int, count: int | None = None) -> NDArray[np.int64]:
        """Return the rows on the measured front of two objectives after `count` measurements (all).

        By the first; of the points within all limits, also those on objectives that are not shown.
        """
        rows = np.flatnonzero(self.succeeded[:count])
        return rows[self._front(self.values[rows], first, second)]

    def recommended(self, first: int, second: int) -> NDArray[np.int64]:
        """Return the rows of `estimates` on the front of the expected values, as `front` does."""
        rows = np.flatnonzero(self.explorer.history.exact())
        return rows[self._front(self.estimates.expected[rows], first, second)]

    def _front(self, values: NDArray[np.float64], first: int, second: int) -> NDArray[np.int64]:
        rows = np.flatnonzero(self.explorer.history.within_limits(values))
        plane = values[rows][:, [first, second]]
        rows = rows[nondominated(plane, [self.maximise[first], self.maximise[second]])]
        return rows[np.lexsort(values[rows][:, [second, first]].T)]

    def values_of(self, parameter: Parameter, indices: Indices) -> NDArray[np.str_]:
        """Return the value of a parameter at (n,) indices, as text."""
        decode = self.explorer.space.decode
        return np.array([str(decode(index)[parameter.name]) for index in indices.tolist()], dtype=np.str_)

    def describe(self, index: int) -> str:
        """Return the configuration of a point of the space as lines of HTML."""
        configuration = self.explorer.space.decode(index)
        return "<br>".join(f"{text(name)} {text(value)}" for name, value in configuration.items())
