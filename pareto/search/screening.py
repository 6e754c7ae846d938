"""The first stage: tree ensembles look at the whole space and leave a few thousand points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pareto.search.history import History
from pareto.search.targets import Targets
from pareto.spaces.sampling import sample
from pareto.spaces.space import Indices, Space
from pareto.surrogates.forest import Forest

if TYPE_CHECKING:
    from pareto.search.transfer import Trend

Array = NDArray[np.float64]

LARGEST_GRID = 5_000_000  # points that are predicted all; of a larger space, a fresh sample is
SAMPLE = 50_000
DRAWS = 1 << 22  # at most, against constraints that hardly any point keeps
DIRECTIONS = 32  # trade-offs between the objectives for which the best candidates are kept
LEAST_CHANCE = 0.05  # of being measurable, for a candidate


@dataclass(frozen=True)
class Screening:
    """Predictions for a pool of unmeasured points.

    (pool,) `indices`, (objectives, pool) `predicted` targets, and the (pool,) `chance` that the point can be
    measured at all.
    """

    indices: Indices
    predicted: Array
    chance: Array


def free_points(history: History, targets: Targets, rng: np.random.Generator) -> Indices:
    """Return what may be measured, is neither measured nor pending, and is to be looked at.

    Ascending: all of a space of up to LARGEST_GRID points; of a larger one a fresh sample and the front's
    neighbours.
    """
    space = history.space
    taken = np.fromiter(history.taken(), dtype=np.int64)
    if len(space) <= LARGEST_GRID:
        free = space.allowed_grid.copy()
        free[taken] = False
        return np.flatnonzero(free)
    drawn = sample(space, SAMPLE, rng, history.taken(), draws=DRAWS)
    return np.setdiff1d(np.concatenate([drawn, beside_front(targets, space)]), taken)


def beside_front(targets: Targets, space: Space) -> Indices:
    """Return the allowed points that differ from one of the measured front in one parameter, ascending."""
    front = [space.neighbours(int(index)) for index in targets.indices[targets.front]]
    return np.unique(np.concatenate(front)) if front else np.empty(0, dtype=np.int64)


def screen(
    history: History,
    targets: Targets,
    trend: Trend,
    pool: Indices,
    trees: int,
    rng: np.random.Generator,
) -> Screening:
    """Predict every point of `pool` by extra trees, one ensemble an objective and one for success.

    The trees learn what `trend` leaves over of the targets.
    """
    space = history.space
    whole = len(space) <= LARGEST_GRID

    def predict(indices: Indices, values: Array) -> Array:
        seed = int(rng.integers(2**31))
        forest = Forest.grow(space.codes(indices), values, space.shape, seed=seed, trees=trees)
        return forest.predict_grid()[pool] if whole else forest.predict(space.codes(pool))

    predicted = (
        np.stack([predict(targets.indices, column) for column in trend.rest(targets).T]) + trend(pool).T
    )
    failed = history.failed()
    chance = np.ones(len(pool))
    if len(failed):
        labels = np.concatenate([np.ones(len(targets.indices)), np.zeros(len(failed))])
        chance = predict(np.concatenate([targets.indices, failed]), labels)
    return Screening(pool, predicted, chance)


def candidates(
    screening: Screening, targets: Targets, space: Space, count: int, rng: np.random.Generator
) -> Indices:
    """Return about `count` distinct points of the pool for the second stage.

    A half are the best for each of DIRECTIONS trade-offs: the least weighted Chebyshev distance to the best
    predicted values, doubtful points set back. A quarter are one-parameter neighbours of the measured front.
    The rest is drawn from all that may lie within the reference, so that the sharp models have a say in it.
    """
    pool, predicted = screening.indices, screening.predicted
    ideal = np.minimum(predicted.min(axis=1), targets.values.min(axis=0))
    room = np.maximum(targets.reference - ideal, targets.floor)
    likely = screening.chance > LEAST_CHANCE
    if np.count_nonzero(likely) < count:
        likely = np.ones(len(pool), dtype=bool)
    near = np.flatnonzero(likely & (predicted < (ideal + 1.25 * room)[:, None]).all(axis=0))
    if len(near) < count:
        near = np.flatnonzero(likely)
    distance = np.stack(
        [(column[near] - low) / width for column, low, width in zip(predicted, ideal, room, strict=True)]
    )
    # Trees predict plateaus: of equals any may come, not always those of the lowest index.
    doubt = 1.0 - screening.chance[near] + 1e-6 * rng.random(len(near))
    each = max(1, count // (2 * DIRECTIONS))
    picked = [
        pool[near[_best(distance, doubt, weights, each)]] for weights in _directions(len(distance), rng)
    ]
    around = beside_front(targets, space)
    place = np.minimum(np.searchsorted(pool, around), len(pool) - 1)
    around = around[pool[place] == around]  # the pool is sorted, and too large for set operations
    picked.append(rng.permutation(around)[: count // 4])
    best = np.unique(np.concatenate(picked))
    others = pool[near[rng.integers(0, len(near), size=max(0, count - len(best)))]]
    return np.union1d(best, others)


def _best(distance: Array, doubt: Array, weights: Array, count: int) -> NDArray[np.int64]:
    """Return the positions of the `count` least weighted distances (objectives, n), the doubtful set back."""

    def score(distance: Array, doubt: Array) -> Array:
        return (distance * weights[:, None]).max(axis=0) + 0.25 * weights.min() * doubt

    # The scores of a regular sample bound the best ones', and nearly all others lie beyond in one objective.
    stride = max(1, distance.shape[1] // 16384)
    sampled = score(distance[:, ::stride], doubt[::stride])
    rank = min(len(sampled) - 1, 4 * count // stride + 8)
    bound = np.partition(sampled, rank)[rank]
    some = np.flatnonzero((distance <= bound / weights[:, None]).all(axis=0))
    return some[np.argsort(score(distance[:, some], doubt[some]), kind="stable")[:count]]


def _directions(objectives: int, rng: np.random.Generator) -> Array:
    """Return (DIRECTIONS, objectives) positive weights whose trade-offs spread from one end to the other."""
    shares = rng.dirichlet(np.ones(objectives), size=DIRECTIONS)
    if objectives == 2:
        even = (np.arange(DIRECTIONS) + rng.random()) / DIRECTIONS
        shares = np.stack([even, 1.0 - even], axis=1)
    return 1.0 / (shares + 0.02)
