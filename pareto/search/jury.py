"""Trees that tell what succeeds from what fails; small batches share them, as to grow them takes longest."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pareto.search.history import read_index
from pareto.spaces.space import Indices, Space
from pareto.surrogates.forest import Forest

TREES = 64


class Jury:
    """Extra trees that learn from `good` and `bad` points; they are grown when first asked."""

    def __init__(self, space: Space, good: Indices, bad: Indices, seed: int) -> None:
        self.space = space
        self.good = good
        self.bad = bad
        self.seed = seed

    def chance(self, indices: Indices) -> NDArray[np.float64]:
        """Return the (n,) chances that `indices` succeed, above 0 and below 1."""
        # One tree more, undecided: nothing is impossible.
        return (TREES * self._forest.predict(self.space.codes(indices)) + 0.5) / (TREES + 1)

    def to_dict(self) -> dict[str, Any]:
        """Return what the trees are grown from as plain JSON; `read` grows the same ones again."""
        return {"good": self.good.tolist(), "bad": self.bad.tolist(), "seed": self.seed}

    @classmethod
    def read(cls, saved: Mapping[str, Any], space: Space) -> Jury:
        """Return the jury that was saved. Raises StateError, KeyError or TypeError where it is damaged."""
        good, bad = (
            np.array([read_index(space, index) for index in saved[name]], dtype=np.int64)
            for name in ("good", "bad")
        )
        return cls(space, good, bad, int(saved["seed"]))

    @cached_property
    def _forest(self) -> Forest:
        codes = self.space.codes(np.concatenate([self.good, self.bad]))
        labels = np.concatenate([np.ones(len(self.good)), np.zeros(len(self.bad))])
        return Forest.grow(codes, labels, self.space.shape, seed=self.seed, trees=TREES)
