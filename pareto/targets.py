"""The numbers that models learn from: minimised, on a log scale where possible, with a reference point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pareto.front import nondominated
from pareto.history import History
from pareto.space import Indices

Array = NDArray[np.float64]

SLACK = 0.5  # of the front's extent, beyond its ends, where the user set no limit


@dataclass(frozen=True)
class Targets:
    """`values` (n, objectives) of the measured `indices`; improvement counts below `reference` only.

    `front` numbers the rows that are non-dominated among those within the reference.
    """

    indices: Indices
    values: Array
    reference: Array
    front: NDArray[np.int64]

    @classmethod
    def of(cls, history: History) -> Targets:
        """Read the history's successes. Raises ValueError when there are none."""
        indices, natural = history.measured()
        if len(indices) == 0:
            raise ValueError("nothing was measured yet")
        values = np.empty_like(natural)
        limits = np.full(natural.shape[1], np.inf)
        for column, objective in enumerate(history.objectives):
            limit = history.limits.get(objective.name)
            positive = natural[:, column].min() > 0 and (limit is None or limit > 0)
            scale = np.log if positive else np.asarray
            values[:, column] = scale(natural[:, column]) * objective.sign
            if limit is not None:
                limits[column] = scale(np.float64(limit)) * objective.sign
        reference = _complete(limits, values)
        inside = np.flatnonzero((values <= reference).all(axis=1))
        return cls(indices, values, reference, inside[nondominated(values[inside])])

    def winsorised(self, excess: float = 0.5) -> Array:
        """Return the values, those beyond the reference pulled in to `excess` of the good range behind it.

        How bad a bad point is does not matter, and would bend smooth models where it does.
        """
        best = np.minimum(self.values.min(axis=0), self.reference)
        room = np.maximum(self.reference - best, 1e-9)
        return np.minimum(self.values, self.reference + excess * room)


def _complete(limits: Array, values: Array) -> Array:
    """Fill in a reference for objectives without a limit: beyond the end of the front within the limits.

    The slack is wide, since whatever lies beyond the reference is worth nothing and will not be looked for:
    a front that is found from its middle must be able to grow outwards. Where the front is a single point
    (one objective, or objectives that agree), it has no extent: the median of what was measured within the
    limits is then the least that the reference lets in.
    """
    keep = (values <= limits).all(axis=1)
    inside = values[keep] if keep.any() else values
    front = inside[nondominated(inside)]
    low, high = front.min(axis=0), front.max(axis=0)
    ends = np.maximum(high + SLACK * np.maximum(high - low, 1e-9), np.median(inside, axis=0))
    return np.where(np.isfinite(limits), limits, ends)
