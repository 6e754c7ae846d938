"""The paper's Algorithm 1 as printed: random samples, then the predicted front until it is all measured."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from pareto.search.history import History
from pareto.search.methods.method import ACTIVE, RANDOM, Method
from pareto.search.predicted_front import TREES, predict_front, require_small
from pareto.spaces.sampling import sample
from pareto.spaces.space import Space, read_index


@dataclass
class Algorithm1(Method):
    """Nardi et al. 2017, Algorithm 1.

    Measure `initial` random configurations; fit one random forest of `trees` trees to each objective;
    predict the whole space and take its front P; measure P minus what is measured; refit; stop when nothing
    is left to measure. It ignores limits and failures. A censored value counts as its bound. All of P is
    measured before the forests are fitted again, so a small `count` spreads it over several calls; with a
    `batch`, only so many points of P, drawn at random.
    """

    whole_rounds: ClassVar[bool] = True

    initial: int = 200
    trees: int = TREES
    batch: int | None = None
    _queue: list[int] = field(default_factory=list, init=False)

    def propose(self, history: History, count: int, rng: np.random.Generator) -> list[tuple[int, str]]:
        """Return the next of the random samples or of P; none while the last of a round are pending."""
        require_small(history.space)
        taken = history.taken()
        missing = self.initial - len(taken)
        if missing > 0:
            drawn = sample(history.space, min(count, missing), rng, exclude=taken)
            if len(drawn):
                return [(index, RANDOM) for index in drawn.tolist()]
        self._queue = [index for index in self._queue if index not in taken]
        if not self._queue and not history.pending:
            front, _ = predict_front(history, self.trees, self.seed)
            left = [index for index in rng.permutation(front).tolist() if index not in taken]
            self._queue = left[: self.batch]
        return [(index, ACTIVE) for index in self._queue[:count]]

    def memory(self) -> dict[str, Any]:
        """Return the part of P that was not returned yet."""
        return {"queue": self._queue}

    def recall(self, memory: Mapping[str, Any], space: Space) -> None:
        """Restore the rest of P."""
        self._queue = [read_index(space, index) for index in memory["queue"]]
