"""The first stage: tree ensembles look at the whole space and leave a few thousand points."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pareto.forest import Forest
from pareto.history import History
from pareto.sampling import sample
from pareto.space import Indices, Space
from pareto.targets import Targets

Array = NDArray[np.float64]

LARGEST_GRID = 5_000_000  # points that are predicted all; of a larger space, a fresh sample is
SAMPLE = 100_000
DIRECTIONS = 32  # trade-offs between the objectives for which the best candidates are kept


@dataclass(frozen=True)
class Screening:
    """Predictions for a pool of unmeasured points.

    (pool,) `indices`, (objectives, pool) `predicted` targets, and the (pool,) `chance` that the point can be
    measured at all.
    """

    indices: Indices
    predicted: Array
    chance: Array


def screen(
    history: History,
    targets: Targets,
    trend: Callable[[Indices], Array],
    trees: int,
    rng: np.random.Generator,
) -> Screening:
    """Predict every point of the space that is neither measured nor pending, or a sample of a huge one.

    The trees learn what `trend` leaves over of the targets.
    """
    space = history.space
    failed = history.failed()
    taken = np.fromiter(history.taken(), dtype=np.int64)
    whole = len(space) <= LARGEST_GRID
    if whole:
        free = np.ones(len(space), dtype=bool)
        free[taken] = False
        pool = np.flatnonzero(free)
    else:
        around = [space.neighbours(int(index)) for index in targets.indices[targets.front]]
        pool = np.concatenate([sample(space, SAMPLE, rng, exclude=history.taken()), *around])
        pool = np.setdiff1d(pool, taken)

    def predict(indices: Indices, values: Array) -> Array:
        seed = int(rng.integers(2**31))
        forest = Forest.grow(space.codes(indices), values, space.shape, seed=seed, trees=trees)
        return forest.predict_grid()[pool] if whole else forest.predict(space.codes(pool))

    rest = targets.winsorised() - trend(targets.indices)
    predicted = np.stack([predict(targets.indices, column) for column in rest.T]) + trend(pool).T
    if len(failed):
        labels = np.concatenate([np.ones(len(targets.indices)), np.zeros(len(failed))])
        chance = predict(np.concatenate([targets.indices, failed]), labels)
    else:
        chance = np.ones(len(pool))
    return Screening(pool, predicted, chance)


def candidates(
    screening: Screening,
    targets: Targets,
    space: Space,
    taken: set[int],
    count: int,
    rng: np.random.Generator,
) -> Indices:
    """Return about `count` distinct points for the second stage, none of them taken.

    Half are the best of the pool for each of DIRECTIONS trade-offs (the least weighted Chebyshev distance to
    the best predicted values, doubtful points set back), half one-parameter neighbours of the measured front.
    """
    predicted = screening.predicted
    ideal = np.minimum(predicted.min(axis=1), targets.values.min(axis=0))
    room = np.maximum(targets.reference - ideal, 1e-9)
    worth = screening.chance > 0.05
    for column, bound in zip(predicted, ideal + 1.25 * room, strict=True):
        worth &= column < bound
    if worth.sum() < count:
        worth = np.ones(len(worth), dtype=bool)
    pool, doubt = screening.indices[worth], 1.0 - screening.chance[worth]
    distance = [
        (column[worth] - low) / width for column, low, width in zip(predicted, ideal, room, strict=True)
    ]
    picked = []
    for weights in _directions(len(distance), rng):
        score = distance[0] * weights[0]
        for column, weight in zip(distance[1:], weights[1:], strict=True):
            np.maximum(score, column * weight, out=score)
        score += 0.25 * weights.min() * doubt
        picked.append(pool[_smallest(score, max(1, count // (2 * DIRECTIONS)))])
    front = targets.indices[targets.front]
    near = [space.neighbours(int(index)) for index in front]
    near_points = rng.permutation(np.unique(np.concatenate(near))) if near else np.empty(0, dtype=np.int64)
    near_points = near_points[~np.isin(near_points, np.fromiter(taken, dtype=np.int64))]
    return np.unique(np.concatenate([*picked, near_points[: count // 2]]))


def _smallest(score: Array, count: int) -> NDArray[np.int64]:
    """Return the positions of about the `count` smallest scores; ties at the end may add a few or be cut."""
    if len(score) <= 4 * count:
        return np.argsort(score, kind="stable")[:count]
    # A regular sample bounds the answer well enough to sort only a small part.
    stride = max(1, len(score) // 16384)
    sampled = score[::stride]
    rank = min(len(sampled) - 1, 4 * count // stride + 8)
    some = np.flatnonzero(score <= np.partition(sampled, rank)[rank])
    return some[np.argsort(score[some], kind="stable")[:count]]


def _directions(objectives: int, rng: np.random.Generator) -> Array:
    """Return (DIRECTIONS, objectives) positive weights whose trade-offs spread from one end to the other."""
    shares = rng.dirichlet(np.ones(objectives), size=DIRECTIONS)
    if objectives == 2:
        even = (np.arange(DIRECTIONS) + rng.random()) / DIRECTIONS
        shares = np.stack([even, 1.0 - even], axis=1)
    return 1.0 / (shares + 0.02)
