"""The measurement noise of each objective, from repeats of configurations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pareto.search.history import History
from pareto.search.targets import Targets

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Noise:
    """The (objectives) `variance` of one measurement in targets, from `freedom` degrees of freedom.

    Without repeats it is unknown. If all repeats agree, there is no noise.
    """

    variance: Array
    freedom: int

    @classmethod
    def of(cls, history: History, targets: Targets) -> Noise:
        """Pool the variance within each repeated configuration, without censored measurements."""
        squares = np.zeros(targets.values.shape[1])
        freedom = 0
        for values in history.repeats():
            table = targets.scale.targets(np.array(values))
            table -= table[0].copy()  # so equal measurements have variance 0, without rounding errors
            squares += ((table - table.mean(axis=0)) ** 2).sum(axis=0)
            freedom += len(values) - 1
        return cls(squares / max(freedom, 1), freedom)

    @classmethod
    def suspected(cls, targets: Targets) -> Noise:
        """The upper bound while nothing was repeated: all residual variance of a model."""
        return cls(np.zeros(targets.values.shape[1]), 0)

    @property
    def known(self) -> bool:
        """Whether anything was repeated."""
        return self.freedom > 0

    def __bool__(self) -> bool:
        """Whether repeats differed."""
        return bool(self.variance.any())

    def expected(self, objective: int, nugget: float) -> float:
        """Return the expected variance: the `nugget` of a process counts as much as one repeat.

        Few repeats say little about a variance, and the residuals of a smooth model bound it. An objective
        whose repeats all agree has no noise.
        """
        variance = float(self.variance[objective])
        if self.known and variance == 0:
            return 0.0
        return (self.freedom * variance + nugget) / (self.freedom + 1)
