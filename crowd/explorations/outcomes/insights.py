"""What a model makes of an exploration's measurements: which parameters matter, how well it foretells.

It takes seconds, so it is done again only when the search has grown by a tenth, and always from the first
measurements up to there: everybody sees the same, and from how many.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from crowd.explorations.outcomes.watching import Watch, found
from pareto import Space
from pareto.surrogates.importance import importance
from pareto.surrogates.prediction import Prediction, predictions

LEAST, GROWTH = 20, 1.1
MOST_ROWS = 1000  # of which a model learns here; the answer hardly changes beyond


@dataclass(frozen=True)
class Insight:
    """By objective: the parameters' shares of the variance, and predictions of measurements unseen.

    Both are None where nothing can be said (all values equal, or too few). `measurements` says of how many
    searched configurations, failed ones included.
    """

    measurements: int
    shares: dict[str, dict[str, float] | None]
    predictions: dict[str, Prediction | None]


def insight(seen: Watch) -> Insight | None:
    """What is to be learnt from the exploration SEEN, None before there are enough measurements."""
    have = found(seen)
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
    """The largest of 20, 22, 24, 26, 29, ... (each a tenth more) that MEASUREMENTS reach; 0 below."""
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
    if len(rows) > MOST_ROWS:
        rows = np.sort(np.random.default_rng(0).permutation(rows)[:MOST_ROWS])
    places = np.array(indices)[rows]
    columns = dict(zip(names, np.array(values, dtype=np.float64)[rows].T, strict=True))
    return Insight(
        measurements=len(indices),
        shares={name: importance(space, places, column) for name, column in columns.items()},
        predictions={name: predictions(space, places, column) for name, column in columns.items()},
    )
