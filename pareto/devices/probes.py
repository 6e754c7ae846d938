"""Which further configurations a device should measure: those that teach most about it and its relatives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pareto.devices.prediction import Belief, Observation

Array = NDArray[np.float64]
NEARLY_BEST = 0.8  # one of those that teach at least this part of the most is taken by chance
ERROR = 0.03  # standard error of a ratio that a probe will have


@dataclass(frozen=True)
class Choice:
    """A chosen `place`, and what each place that was left would have taught."""

    place: int
    gains: dict[int, float]


def choose(
    belief: Belief,
    relatives: Sequence[Belief],
    candidates: Sequence[int],
    wanted: Sequence[int],
    count: int,
    seed: int,
) -> list[Choice]:
    """At most COUNT of the places CANDIDATES, the first teaching most.

    BELIEF is that about the device after what it measured, RELATIVES are those about others of its family.
    What a measurement teaches is by how much it lowers the sum of the variances of the quantities WANTED, on
    the device and, by `belief.relation` squared, on its relatives. SEED decides between nearly equal ones, so
    that many alike devices do not all measure the same.
    """
    chance = np.random.default_rng(seed)
    left, chosen = list(candidates), list[Choice]()
    beliefs = [belief, *relatives]
    weights = [1.0] + [belief.relation**2] * len(relatives)
    while left and len(chosen) < count:
        gains = sum(weight * _gain(each, left, wanted) for weight, each in zip(weights, beliefs, strict=True))
        nearly = np.flatnonzero(gains >= NEARLY_BEST * np.max(gains))
        place = left[int(chance.choice(nearly))]
        chosen.append(Choice(place, dict(zip(left, np.asarray(gains).tolist(), strict=True))))
        left.remove(place)
        beliefs = [_measured(each, place) for each in beliefs]
    return chosen


def _gain(belief: Belief, candidates: Sequence[int], wanted: Sequence[int]) -> Array:
    """By how much each of CANDIDATES lowers the sum of the variances of WANTED, (candidates,)."""
    covariance = belief.covariance[np.ix_(list(wanted), list(candidates))]
    own = np.diag(belief.covariance)[list(candidates)] + ERROR**2
    return np.asarray((covariance**2).sum(axis=0) / own)


def _measured(belief: Belief, place: int) -> Belief:
    """BELIEF as it will be once the quantity at PLACE was measured; what the value is changes no variance."""
    there = np.array([place])
    return belief.after(Observation(there, belief.mean[there], np.array([ERROR])))
