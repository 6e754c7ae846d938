"""What random samples and active learning found, each by itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from frontrunner.paper.exploration import Exploration
from pareto.fronts.front import nondominated
from pareto.fronts.hypervolume import hypervolume
from pareto.search.methods.method import RANDOM
from wire.protocol import VALID_BELOW


@dataclass(frozen=True)
class Phases:
    """The (n, 2) errors and times of the successes of a search, in order of arrival; `random` marks samples.

    `samples` and `points` count random samples and points of active learning, failed ones included.
    """

    values: NDArray[np.float64]
    random: NDArray[np.bool_]
    samples: int
    points: int

    @classmethod
    def of(cls, exploration: Exploration) -> Phases:
        """Read the history of a search."""
        history = exploration.explorer.history
        indices, values = history.measured()
        random = np.array([history.phases[index] == RANDOM for index in indices.tolist()], dtype=bool)
        samples = sum(phase == RANDOM for phase in history.phases.values())
        return cls(values, random, samples, len(history.phases) - samples)

    @property
    def valid(self) -> NDArray[np.bool_]:
        """(n,) whether the error is within the limit in every frame."""
        return np.asarray(self.values[:, 0] < VALID_BELOW)

    def front(self, rows: NDArray[np.bool_] | None = None) -> NDArray[np.float64]:
        """(points, 2) values of the valid `rows` (all where None) that no other of them beats, by error."""
        values = self.values[self.valid if rows is None else self.valid & rows]
        values = values[nondominated(values)]
        return values[np.lexsort(values.T[::-1])]

    def volume(self, rows: NDArray[np.bool_]) -> float:
        """The hypervolume of the logarithms of `rows`, up to the limit and the slowest time of all."""
        if not len(self.values):
            return 0.0
        return hypervolume(self.values[rows], [VALID_BELOW, self.values[:, 1].max()], log=True)
