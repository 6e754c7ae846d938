"""The default method: trees screen the whole space, Gaussian processes decide near the front."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from pareto.gaussian import GaussianProcess, Posterior
from pareto.history import History
from pareto.improvement import expected_improvement
from pareto.methods.method import ACTIVE, RANDOM, Method
from pareto.sampling import sample, spread_sample
from pareto.screening import candidates, screen
from pareto.targets import Targets
from pareto.transfer import Trend, trusted

Array = NDArray[np.float64]

SHORTLIST = 1000  # candidates that stay in the race after the first of a batch is picked


@dataclass
class TwoStage(Method):
    """Expected hypervolume improvement over a screened pool.

    `initial` evenly spread configurations come first, the default among them. Then each batch: extra trees
    on log targets predict the whole space; about `candidates` points near the predicted front and around the
    measured one go to Matern-5/2 Gaussian processes fitted to at most `points` measurements near the front;
    points are taken greedily by expected hypervolume improvement times the chance to be measurable. One in
    `explore` of the batch is drawn at random instead, so that exploration never dries up.

    With a prior, half as many come first while it is borne out, every other of them one that did well on the
    other device, and the models learn what the trend between the two devices leaves over.
    """

    uses_prior: ClassVar[bool] = True

    initial: int = 40
    trees: int = 64
    candidates: int = 6000
    points: int = 600
    explore: int = 10

    def propose(self, history: History, count: int, rng: np.random.Generator) -> list[tuple[int, str]]:
        """Return `count` proposals, or what is left of the space."""
        taken = history.taken()
        count = min(count, len(history.space) - len(taken))
        helped = bool(history.prior) and trusted(history)
        initial = (self.initial + 1) // 2 if helped else self.initial
        first = min(initial - len(taken), count)
        chosen = self._first(history, first, helped, rng) if first > 0 else []
        count -= len(chosen)
        measured, _ = history.measured()
        exploring = int(rng.binomial(count, 1.0 / self.explore)) if len(measured) and count else count
        if count > exploring:
            # On matrices of a few hundred rows, threads of BLAS cost six times what they save.
            with threadpool_limits(limits=1, user_api="blas"):
                chosen += self._best(history, count - exploring, {index for index, _ in chosen}, rng)
        # Where no candidate promises anything, the rest of the batch explores.
        missing = count - (len(chosen) - max(first, 0))
        exclude = taken | {index for index, _ in chosen}
        return chosen + [(index, RANDOM) for index in sample(history.space, missing, rng, exclude).tolist()]

    def _first(
        self, history: History, count: int, helped: bool, rng: np.random.Generator
    ) -> list[tuple[int, str]]:
        taken = history.taken()
        default = history.space.encode(history.space.default)
        first = [] if default in taken else [default]
        proven: list[int] = []
        if helped and history.prior:
            phases = [*(history.phases | history.pending).values()]
            wanted = (len(taken) + count) // 2 - phases.count(ACTIVE)
            proven = history.prior.promising(min(wanted, count - len(first)), taken | {default}).tolist()
        exclude = taken | {default, *proven}
        rest = spread_sample(history.space, count - len(first) - len(proven), rng, exclude)
        spread = [(index, RANDOM) for index in [*first, *rest.tolist()]]
        return spread + [(index, ACTIVE) for index in proven]

    def _best(
        self, history: History, count: int, also_taken: set[int], rng: np.random.Generator
    ) -> list[tuple[int, str]]:
        space = history.space
        targets = Targets.of(history)
        trend = Trend.of(history, targets)
        screening = screen(history, targets, trend, self.trees, rng)
        taken = history.taken() | also_taken
        found = candidates(screening, targets, space, taken, self.candidates, rng)
        waiting = np.array([*history.pending, *also_taken], dtype=np.int64)
        indices = np.concatenate([found, waiting])
        features = space.features(indices)
        near = _near_the_front(targets, self.points, rng)
        train = space.features(targets.indices[near])
        posteriors = [
            GaussianProcess.fit(train, column, space.feature_owner, rng).at(features)
            for column in (targets.winsorised() - trend(targets.indices))[near].T
        ]
        for posterior, expected in zip(posteriors, trend(indices).T, strict=True):
            posterior.mean += expected
        chance = _chance(history, targets, features, self.points, rng)
        picked = _greedy(posteriors, chance, len(found), targets, count, rng)
        return [(int(found[number]), ACTIVE) for number in picked]


def _near_the_front(targets: Targets, points: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Return the rows to learn from: all, or mostly those closest to the front and some of the others."""
    count = len(targets.values)
    if count <= points:
        return np.arange(count)
    front = targets.values[targets.front] if len(targets.front) else targets.reference[None]
    scale = np.maximum(np.ptp(np.vstack([front, targets.reference]), axis=0), 1e-9)
    behind = ((targets.values[:, None] - front) / scale).max(axis=2).min(axis=1)
    order = np.argsort(behind, kind="stable")
    near = points * 4 // 5
    return np.concatenate([order[:near], rng.permutation(order[near:])[: points - near]])


def _chance(
    history: History, targets: Targets, features: Array, points: int, rng: np.random.Generator
) -> Array:
    """Return the probability that a candidate can be measured, from a process on success and failure."""
    failed = history.failed()
    if len(failed) == 0:
        return np.ones(len(features))
    good = rng.permutation(targets.indices)[: points // 2]
    bad = rng.permutation(failed)[: points // 2]
    labels = np.concatenate([np.ones(len(good)), -np.ones(len(bad))])
    train = history.space.features(np.concatenate([good, bad]))
    process = GaussianProcess.fit(train, labels, history.space.feature_owner, rng)
    posterior = process.at(features)
    return ndtr(posterior.mean / posterior.spread)


def _greedy(
    posteriors: list[Posterior],
    chance: Array,
    found: int,
    targets: Targets,
    count: int,
    rng: np.random.Generator,
) -> list[int]:
    """Return the numbers of `count` of the first `found` candidates.

    Each is the best once those before it turn out as expected. The candidates from `found` on are under way
    already and are supposed first.
    """
    front = targets.values[targets.front]
    gain_of = np.where(np.arange(len(chance)) < found, chance, -1.0)  # -1: not to be picked, or not again
    alive = np.arange(len(chance))
    picked: list[int] = []
    for number in range(found, len(chance)):
        front = _suppose(posteriors, number, front)
    for _ in range(min(count, found)):
        mean = np.stack([posterior.mean for posterior in posteriors], axis=1)
        spread = np.stack([posterior.spread for posterior in posteriors], axis=1)
        gain = gain_of * expected_improvement(mean, spread, front, targets.reference, rng)
        best = int(np.argmax(gain))
        if gain[best] <= 0:
            break
        picked.append(int(alive[best]))
        front = _suppose(posteriors, best, front)
        gain_of[best] = -1.0
        if len(alive) > SHORTLIST + count:
            # Gains only fall from here on, so those far behind now will not be picked.
            keep = np.sort(np.argpartition(-gain, SHORTLIST + count)[: SHORTLIST + count])
            for posterior in posteriors:
                posterior.keep(keep)
            alive, gain_of = alive[keep], gain_of[keep]
    return picked


def _suppose(posteriors: list[Posterior], number: int, front: Array) -> Array:
    """Condition all posteriors on candidate `number` and return the front with its expected value added."""
    for posterior in posteriors:
        posterior.suppose(number)
    return np.vstack([front, [posterior.mean[number] for posterior in posteriors]])
