"""Trees that predict success or failure."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pareto.errors import StateError
from pareto.spaces.grid import Indices
from pareto.spaces.space import Space, read_index
from pareto.surrogates.forest import Forest

TREES = 64


class Success:
    """Extremely randomised trees that learn from `good` and `bad` points (Geurts et al. 2006).

    They are grown on first use.
    """

    def __init__(self, space: Space, good: Indices, bad: Indices, seed: int) -> None:
        self.space = space
        self.good = good
        self.bad = bad
        self.seed = seed

    def __len__(self) -> int:
        """The number of points that the trees learn from."""
        return len(self.good) + len(self.bad)

    def chance(self, indices: Indices) -> NDArray[np.float64]:
        """Return the (n,) chances that `indices` succeed, above 0 and below 1."""
        # Another, undecided tree, so that no probability is 0 or 1.
        return (TREES * self._forest.predict(self.space.codes(indices)) + 0.5) / (TREES + 1)

    def to_dict(self) -> dict[str, Any]:
        """Return the trees' data as plain JSON; `read` grows the same trees again."""
        return {"good": self.good.tolist(), "bad": self.bad.tolist(), "seed": self.seed}

    @classmethod
    def read(cls, saved: Mapping[str, Any], space: Space) -> Success:
        """Return what was saved. Raises StateError, KeyError or TypeError where it is damaged."""
        good, bad = (
            np.array([read_index(space, index) for index in saved[name]], dtype=np.int64)
            for name in ("good", "bad")
        )
        seed = int(saved["seed"])
        if seed < 0 or not len(good) + len(bad):
            raise StateError(f"the state is damaged: a model of success has seed {seed} and {saved!r:.80}")
        return cls(space, good, bad, seed)

    @cached_property
    def _forest(self) -> Forest:
        codes = self.space.codes(np.concatenate([self.good, self.bad]))
        labels = np.concatenate([np.ones(len(self.good)), np.zeros(len(self.bad))])
        return Forest.grow(codes, labels, self.space.shape, seed=self.seed, trees=TREES)
