"""Drawing distinct configurations from a space that may be too large to enumerate."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from pareto.space import Indices, Space


def sample(space: Space, count: int, rng: np.random.Generator, exclude: Collection[int] = ()) -> Indices:
    """Return `count` distinct indices drawn uniformly, none of them in `exclude`, in random order.

    Fewer are returned only when the space has no more. Memory grows with `count` and `exclude`, never with
    the space.
    """
    taken = {int(index) for index in exclude if 0 <= index < len(space)}
    free = len(space) - len(taken)
    if count >= free or (count + len(taken)) * 2 > len(space):
        # Most of the space is wanted or gone: the space itself is then no larger than the answer, roughly.
        rest = np.setdiff1d(np.arange(len(space), dtype=np.int64), np.fromiter(taken, np.int64, len(taken)))
        return rng.permutation(rest)[:count]
    drawn: list[int] = []
    while len(drawn) < count:
        for index in rng.integers(0, len(space), size=2 * (count - len(drawn))).tolist():
            if index not in taken:
                taken.add(index)
                drawn.append(index)
    return np.array(drawn[:count], dtype=np.int64)


def spread_sample(
    space: Space, count: int, rng: np.random.Generator, exclude: Collection[int] = ()
) -> Indices:
    """Return `count` distinct indices that cover every parameter's values evenly, none in `exclude`.

    A Latin hypercube: each parameter's values appear equally often, up to rounding, in independent random
    orders. Duplicates and excluded points are replaced by uniform draws.
    """
    columns = []
    for size in space.shape:
        levels = (np.arange(count) + rng.random()) * size / max(count, 1)
        columns.append(rng.permutation(np.floor(levels).astype(np.int64) % size))
    proposed = space.indices(np.stack(columns, axis=-1)).tolist()
    taken = {int(index) for index in exclude}
    kept = [index for index in dict.fromkeys(proposed) if index not in taken]
    filled = sample(space, count - len(kept), rng, exclude=taken | set(kept))
    return np.concatenate([np.array(kept, dtype=np.int64), filled])
