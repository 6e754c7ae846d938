"""Drawing distinct allowed points from a space that may be too large to enumerate."""

from __future__ import annotations

from collections.abc import Collection
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from pareto.spaces.grid import CHUNK, Indices
from pareto.spaces.region import Region
from pareto.spaces.space import Space

DRAWS = 2**25  # some seconds


def sample(
    space: Space,
    count: int,
    rng: np.random.Generator,
    exclude: Collection[int] = (),
    draws: int = DRAWS,
) -> Indices:
    """Return `count` distinct allowed indices drawn uniformly, none of them in `exclude`, in random order.

    Fewer are returned only when the space has no more, or after `draws` draws where constraints or conditions
    link too much to be tabulated (see `Region`). In a folded region values are uniform rather than points.
    Memory grows with `count` and `exclude`, never with the space.
    """
    region = space.region
    taken = np.unique(np.fromiter((i for i in exclude if 0 <= i < len(space)), dtype=np.int64))
    if space.clauses:
        taken = taken[space.allowed(taken)]
    if count >= region.size - len(taken) or (count + len(taken)) * 2 > region.size:
        # Most of the points are wanted or excluded: enumerating them costs about as much as the answer.
        every = region.at(np.arange(region.size, dtype=np.int64))
        return rng.permutation(np.setdiff1d(every[region.keeps(every)], taken))[:count]
    return _drawn(region, count, rng, taken, draws)


def spread_sample(
    space: Space,
    count: int,
    rng: np.random.Generator,
    exclude: Collection[int] = (),
    draws: int = DRAWS,
    guided: bool = False,
) -> Indices:
    """Return `count` distinct allowed indices that cover every parameter's values evenly, none in `exclude`.

    A Latin hypercube: each parameter's values appear equally often, up to rounding, in independent random
    orders. Parameters that constraints link count as one, whose values are the allowed combinations. Inactive
    parameters take part with all their values, so that each value of the others appears equally often.
    Duplicates and excluded points are replaced as by `sample`, at most `draws` times. Where `guided`, values
    appear as often as the user's weights say.
    """
    region = space.region_of_values
    columns = []
    for factor, size in zip(region.factors, region.sizes, strict=True):
        levels = (np.arange(count) + rng.random()) * size / max(count, 1)
        if guided:
            weights = np.cumsum(space.weights(factor))
            levels = np.searchsorted(weights, levels / size * weights[-1], side="right")
        columns.append(rng.permutation(np.floor(levels).astype(np.int64) % size))
    proposed = region.join(np.stack(columns, axis=-1))
    proposed = proposed[region.keeps(proposed)]
    taken = {int(index) for index in exclude}
    kept = [index for index in dict.fromkeys(proposed.tolist()) if index not in taken]
    filled = sample(space, count - len(kept), rng, taken | set(kept), draws)
    return np.concatenate([np.array(kept, dtype=np.int64), filled])


def first_design(space: Space, count: int, rng: np.random.Generator, exclude: Collection[int]) -> Indices:
    """Return up to `count` points of a spread sample; a user's prior guides every second one."""
    spread = spread_sample(space, count, rng, exclude)
    if not space.value_weights:
        return spread
    guided = spread_sample(space, count // 2, rng, exclude, guided=True)
    pairs = zip(guided.tolist(), spread.tolist(), strict=False)
    return np.array(list(dict.fromkeys(chain.from_iterable(pairs))), dtype=np.int64)


def _drawn(region: Region, count: int, rng: np.random.Generator, taken: Indices, draws: int) -> Indices:
    """Draw until `count` points are found that are neither `taken` (sorted) nor drawn before."""
    drawn = np.empty(0, dtype=np.int64)
    size, made = 2 * count, 0
    limited = bool(region.open or region.folded)
    while len(drawn) < count and (made < draws or not limited):
        fresh = region.at(rng.integers(0, region.size, size=size))
        fresh = fresh[region.keeps(fresh)]
        fresh = fresh[~_among(fresh, taken) & ~_among(fresh, np.sort(drawn))]
        _, first = np.unique(fresh, return_index=True)
        drawn = np.concatenate([drawn, fresh[np.sort(first)]])
        made += size
        # Where few draws are allowed, more are made at a time.
        size = min(4 * CHUNK, 2 * size) if limited else 2 * max(count - len(drawn), 0)
    return drawn[:count]


def _among(indices: Indices, ordered: Indices) -> NDArray[np.bool_]:
    """Return which `indices` are in `ordered`, by bisection: `ordered` may be far longer."""
    if not len(ordered):
        return np.zeros(len(indices), dtype=bool)
    places = np.minimum(np.searchsorted(ordered, indices), len(ordered) - 1)
    among: NDArray[np.bool_] = ordered[places] == indices
    return among
