"""The front of the whole space as random forests predict it from the measurements: P of Algorithm 1."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pareto.errors import MethodError
from pareto.fronts.front import nondominated
from pareto.search.history import History
from pareto.spaces.grid import Indices
from pareto.spaces.space import Space
from pareto.surrogates.forest import LARGEST_GRID, Forest

TREES = 100  # of each forest


def require_small(space: Space) -> None:
    """Raise MethodError for a space with too many points to predict them all."""
    if len(space) > LARGEST_GRID:
        raise MethodError(
            f"algorithm1 predicts the whole space, and {len(space):,} points are too many "
            f"(at most {LARGEST_GRID:,}): use another method, or fewer values (a count for reals)"
        )


def predict_front(history: History, trees: int, seed: int) -> tuple[Indices, NDArray[np.float64]]:
    """Return (n,) indices and (n, objectives) predicted values of P, in index order; none without a success.

    One random forest of `trees` trees learns each objective. Equal histories and seeds give the same P.
    Limits and failures are ignored, and a censored value counts as its bound. Raises MethodError for a space
    that is too large.
    """
    space = history.space
    require_small(space)
    indices, values = history.measured()
    if len(indices) == 0:
        return indices, values
    codes = space.codes(indices)
    predicted = np.empty((len(space), values.shape[1]))
    rng = np.random.default_rng(seed)
    for column in range(values.shape[1]):
        grown = int(rng.integers(2**31))
        forest = Forest.grow(codes, values[:, column], space.shape, seed=grown, trees=trees, extra=False)
        predicted[:, column] = forest.predict_grid()
    allowed = np.flatnonzero(space.allowed_grid)
    keep = nondominated(predicted[allowed], [objective.maximise for objective in history.objectives])
    return allowed[keep], predicted[allowed[keep]]
