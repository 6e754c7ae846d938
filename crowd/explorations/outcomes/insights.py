"""Insights of a model of an exploration's measurements: important parameters, and quality of predictions.

They take seconds, so they are computed again only after the search has grown by a tenth, from all
measurements up to there. So all viewers see the same.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from crowd.explorations.outcomes.watching import ExplorationStatus, results_of
from pareto import Space
from pareto.surrogates.importance import importance
from pareto.surrogates.prediction import Prediction, predictions

LEAST, GROWTH = 20, 1.1
MAX_ROWS = 1000  # that the model learns from: more hardly change the result


@dataclass(frozen=True)
class Insight:
    """By objective: the parameters' shares of the variance, and predictions of unseen measurements.

    Both are None if all values are equal or too few. `measurements`: the number of searched configurations,
    failed ones included.
    """

    measurements: int
    shares: dict[str, dict[str, float] | None]
    predictions: dict[str, Prediction | None]


def insight(seen: ExplorationStatus) -> Insight | None:
    """The insight into the exploration `seen`; None with too few measurements."""
    have = results_of(seen)
    count = milestone(len(have.indices))
    if not count:
        return None
    names = tuple(seen.exploration.objectives)
    return _insight(
        Space.from_dict(seen.exploration.space),
        names,
        have.indices[:count],
        tuple(tuple((values or {}).get(name) for name in names) for values in have.values[:count]),
    )


def milestone(measurements: int) -> int:
    """The largest of 20, 22, 24, 26, 29, ... (each a tenth more) that is at most `measurements`; 0 below."""
    reached, following = 0, float(LEAST)
    while int(following) <= measurements:
        reached, following = int(following), following * GROWTH
    return reached


@lru_cache(maxsize=8)
def _insight(
    space: Space,
    names: tuple[str, ...],
    indices: tuple[int, ...],
    values: tuple[tuple[float | None, ...], ...],
) -> Insight:
    rows = np.arange(len(indices))
    if len(rows) > MAX_ROWS:
        rows = np.sort(np.random.default_rng(0).permutation(rows)[:MAX_ROWS])
    places = np.array(indices)[rows]
    columns = dict(zip(names, np.array(values, dtype=np.float64)[rows].T, strict=True))
    return Insight(
        measurements=len(indices),
        shares={name: importance(space, places, column) for name, column in columns.items()},
        predictions={name: predictions(space, places, column) for name, column in columns.items()},
    )
