"""The candidates of a search: drawn points that may succeed, and the neighbours of good ones."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from pareto.search.targets import Targets
from pareto.spaces.grid import Indices
from pareto.spaces.sampling import sample
from pareto.spaces.space import Space
from pareto.surrogates.success import Success

LIKELY = 10  # points drawn for each that is taken, in proportion to their chance to succeed
DRAWS = 1 << 22  # at most, for constraints that few points keep


def pool(
    targets: Targets,
    space: Space,
    measurable: Success | None,
    count: int,
    taken: Collection[int],
    rng: np.random.Generator,
) -> Indices:
    """Return about `count` free points, ascending: all where the allowed part of the space is that small.

    Otherwise one half is drawn from everywhere, the other half from the neighbours of the measured front.
    """
    if space.region.size <= count:
        drawn = sample(space, count, rng, taken, draws=DRAWS)
    else:
        around = rng.permutation(front_neighbours(targets, space))[: count // 2]
        drawn = np.concatenate([likely_points(space, measurable, count - len(around), taken, rng), around])
    return np.setdiff1d(drawn, np.fromiter(taken, dtype=np.int64))


def likely_points(
    space: Space, measurable: Success | None, count: int, taken: Collection[int], rng: np.random.Generator
) -> Indices:
    """Return up to `count` distinct random indices, none of them `taken`.

    Once something failed, each is chosen from LIKELY uniform ones in proportion to its chance to succeed:
    where nearly everything fails, exploring would find out little else. The chance is never zero, so points
    that are expected to fail are explored, too, but rarely.
    """
    if measurable is None:
        return sample(space, count, rng, taken, draws=DRAWS)
    drawn = sample(space, LIKELY * count, rng, taken, draws=DRAWS)
    if len(drawn) <= count:
        return drawn
    chance = measurable.chance(drawn)
    return rng.choice(drawn, size=count, replace=False, p=chance / chance.sum())


def front_neighbours(targets: Targets, space: Space) -> Indices:
    """Return the allowed points that differ from one of the measured front in one parameter, ascending."""
    return neighbours(targets.indices[targets.front], space)


def neighbours(indices: Indices, space: Space) -> Indices:
    """Return the allowed points that differ from one of `indices` in one parameter, ascending."""
    near = [space.neighbours(int(index)) for index in indices]
    return np.unique(np.concatenate(near)) if near else np.empty(0, dtype=np.int64)
