"""Random proposals: uniform while nothing failed, then mostly of what may be expected to succeed."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from pareto.search.history import History
from pareto.search.jury import Jury
from pareto.search.screening import DRAWS
from pareto.spaces.sampling import sample
from pareto.spaces.space import Indices

CHOICE = 20  # points that are drawn for each that is proposed


def explored(history: History, count: int, exclude: Collection[int], rng: np.random.Generator) -> Indices:
    """Return up to `count` distinct random indices, none of them in `exclude`.

    Once something failed, each is chosen from CHOICE uniform ones in proportion to its chance of success:
    where nearly everything fails, exploring would else find out little more than that. The chance is never
    zero, so that what is expected to fail is explored, too, but rarely.
    """
    failed, (succeeded, _) = history.failed(), history.measured()
    if count == 0 or len(failed) == 0 or len(succeeded) == 0:
        return sample(history.space, count, rng, exclude, draws=DRAWS)
    drawn = sample(history.space, CHOICE * count, rng, exclude, draws=DRAWS)
    if len(drawn) <= count:
        return drawn
    chance = Jury(history.space, succeeded, failed, seed=int(rng.integers(2**31))).chance(drawn)
    return rng.choice(drawn, size=count, replace=False, p=chance / chance.sum())
