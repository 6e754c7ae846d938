"""Uniform random search without repetition: the baseline."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pareto.search.history import History
from pareto.search.methods.method import RANDOM, Method
from pareto.spaces.sampling import sample


@dataclass
class Random(Method):
    """Draws uniformly from the remaining points; `initial` is every method's option, without effect here."""

    initial: int = 40

    def propose(self, history: History, count: int, rng: np.random.Generator) -> list[tuple[int, str]]:
        """Return `count` uniform draws without replacement."""
        drawn = sample(history.space, count, rng, exclude=history.taken())
        return [(index, RANDOM) for index in drawn.tolist()]
