"""Which further configurations a device should measure: those with the largest information gain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pareto.devices.prediction import Belief, Observation

Array = NDArray[np.float64]
NEARLY_BEST = 0.8  # a random one of those with at least this share of the largest gain is taken
ERROR = 0.03  # expected standard error of a probe's ratio


@dataclass(frozen=True)
class Choice:
    """A chosen `place`, and the gains of all places that were available."""

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
    """At most `count` of the places `candidates`, by descending gain.

    `belief` is about the device after its measurements, `relatives` are about others of its family. The gain
    of a measurement is the decrease of the sum of the variances of the quantities `wanted`, on the device
    and, weighted with `belief.relation` squared, on its relatives. `seed` decides between nearly equal ones,
    so that similar devices measure different probes.
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
    """The decrease of the sum of the variances of `wanted` by each of `candidates`, (candidates,)."""
    covariance = belief.covariance[np.ix_(list(wanted), list(candidates))]
    variances = np.diag(belief.covariance)[list(candidates)] + ERROR**2
    return np.asarray((covariance**2).sum(axis=0) / variances)


def _measured(belief: Belief, place: int) -> Belief:
    """`belief` after a measurement of the quantity at `place`; the variances do not depend on its value."""
    there = np.array([place])
    return belief.after(Observation(there, belief.mean[there], np.array([ERROR])))
