"""The paper's Algorithm 1 as printed: random samples, then the predicted front until it is all measured."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pareto.errors import MethodError
from pareto.fronts.front import nondominated
from pareto.search.history import History
from pareto.search.methods.method import ACTIVE, RANDOM, Method
from pareto.spaces.sampling import sample
from pareto.spaces.space import Space, read_index
from pareto.surrogates.forest import LARGEST_GRID, Forest


@dataclass
class Algorithm1(Method):
    """Nardi et al. 2017, Algorithm 1.

    Measure `initial` random configurations; fit one random forest of `trees` trees to each objective;
    predict the whole space and take its front P; measure P minus what is measured; refit; stop when nothing
    is left to measure. It ignores limits and failures. A censored value counts as its bound. All of P is
    measured before the forests are fitted again, so a small `count` spreads it over several calls.
    """

    initial: int = 200
    trees: int = 100
    _queue: list[int] = field(default_factory=list, init=False)

    def propose(self, history: History, count: int, rng: np.random.Generator) -> list[tuple[int, str]]:
        """Return the next of the random samples or of P; none while the last of a round are pending."""
        if len(history.space) > LARGEST_GRID:
            raise MethodError(
                f"algorithm1 predicts the whole space, and {len(history.space):,} points are too many "
                f"(at most {LARGEST_GRID:,}): use another method, or fewer values (a count for reals)"
            )
        taken = history.taken()
        missing = self.initial - len(taken)
        if missing > 0:
            drawn = sample(history.space, min(count, missing), rng, exclude=taken)
            if len(drawn):
                return [(index, RANDOM) for index in drawn.tolist()]
        self._queue = [index for index in self._queue if index not in taken]
        if not self._queue and not history.pending:
            self._queue = [
                index for index in _predicted_front(history, self.trees, rng) if index not in taken
            ]
        return [(index, ACTIVE) for index in self._queue[:count]]

    def memory(self) -> dict[str, Any]:
        """Return the part of P that was not returned yet."""
        return {"queue": self._queue}

    def recall(self, memory: Mapping[str, Any], space: Space) -> None:
        """Restore the rest of P."""
        self._queue = [read_index(space, index) for index in memory["queue"]]


def _predicted_front(history: History, trees: int, rng: np.random.Generator) -> list[int]:
    indices, values = history.measured()
    if len(indices) == 0:
        return []
    space = history.space
    codes = space.codes(indices)
    predicted = np.empty((len(space), values.shape[1]))
    for column in range(values.shape[1]):
        seed = int(rng.integers(2**31))
        forest = Forest.grow(codes, values[:, column], space.shape, seed=seed, trees=trees, extra=False)
        predicted[:, column] = forest.predict_grid()
    allowed = np.flatnonzero(space.allowed_grid)
    keep = nondominated(predicted[allowed], [objective.maximise for objective in history.objectives])
    order: list[int] = rng.permutation(allowed[keep]).tolist()
    return order
