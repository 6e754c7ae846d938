"""The sharp models: Gaussian processes near the front, and what they promise of single points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from pareto.forest import Forest
from pareto.gaussian import GaussianProcess, Posterior
from pareto.history import History
from pareto.improvement import expected_improvement
from pareto.space import Indices
from pareto.targets import Targets
from pareto.transfer import Trend

Array = NDArray[np.float64]
Hyperparameters = list[list[float]]  # plain numbers, so that they can be saved

TREES = 32


class Surrogates:
    """A process for each objective's target and, once something failed, two models of success (1, -1).

    Success is judged by a process, which follows borders across several parameters, and by trees, which find
    those along the axes; `Promise.gain` says how the two are brought together.
    """

    def __init__(
        self,
        history: History,
        targets: Targets,
        trend: Trend,
        points: int,
        rng: np.random.Generator,
        known: Hyperparameters | None = None,
    ) -> None:
        """Learn from at most `points` measurements near the front, and from as many successes and failures.

        The processes learn what `trend` leaves over. With `known` hyperparameters (of an earlier fit with as
        many models) they are not searched for again.
        """
        self.space = history.space
        self.targets = targets
        self._trend = trend
        self._known = list(known or [])
        near = _near_the_front(targets, points, rng)
        rest = trend.rest(targets)[near]
        self._objectives = [self._process(targets.indices[near], column, rng) for column in rest.T]
        self._success: GaussianProcess | None = None
        failed = history.failed()
        if len(failed):
            good = rng.permutation(targets.indices)[: points // 2]
            bad = rng.permutation(failed)[: points // 2]
            labels = np.concatenate([np.ones(len(good)), -np.ones(len(bad))])
            told = np.concatenate([good, bad])
            self._success = self._process(told, labels, rng)
            seed = int(rng.integers(2**31))
            codes = self.space.codes(told)
            self._trees = Forest.grow(codes, labels, self.space.shape, seed=seed, trees=TREES)

    @property
    def hyperparameters(self) -> Hyperparameters:
        """What was found, for another's `known`."""
        processes = [*self._objectives, *([self._success] if self._success else [])]
        return [process.theta.tolist() for process in processes]

    def at(self, indices: Indices) -> Promise:
        """Return what the models say about `indices`."""
        features = self.space.features(indices)
        objectives = [process.at(features) for process in self._objectives]
        for posterior, expected in zip(objectives, self._trend(indices).T, strict=True):
            posterior.mean += expected
        if self._success is None:
            return Promise(indices, objectives, None, np.ones(len(indices)))
        vote = (1.0 + self._trees.predict(self.space.codes(indices))) / 2.0
        return Promise(indices, objectives, self._success.at(features), vote)

    def _process(self, indices: Indices, column: Array, rng: np.random.Generator) -> GaussianProcess:
        features, owner = self.space.features(indices), self.space.feature_owner
        if self._known:
            return GaussianProcess(features, column, owner, np.array(self._known.pop(0)))
        return GaussianProcess.fit(features, column, owner, rng)


@dataclass
class Promise:
    """Posteriors at `indices`: one an objective, and one of success where anything failed so far.

    `vote` is the share of trees that expect success.
    """

    indices: Indices
    objectives: list[Posterior]
    success: Posterior | None
    vote: Array

    def gain(self, front: Array, reference: Array, rng: np.random.Generator) -> Array:
        """Return the expected improvement of each point times its chance to be measurable.

        The chance is the mean of what process and trees say: neither has a veto.
        """
        mean = np.stack([posterior.mean for posterior in self.objectives], axis=1)
        spread = np.stack([posterior.spread for posterior in self.objectives], axis=1)
        gain = expected_improvement(mean, spread, front, reference, rng)
        if self.success is None:
            return gain
        return gain * (self.vote + ndtr(self.success.mean / self.success.spread)) / 2.0

    def suppose(self, number: int) -> Array:
        """Take point `number` as measured with what is expected; return the rows that this adds to a front.

        Where failure is expected there is none, and what is like it looks less likely to succeed from here
        on: a batch does not bet all on one region of which nobody knows whether it can be measured.
        """
        if self.success is not None:
            self.success.suppose(number)
            if self.success.mean[number] < 0:
                return np.empty((0, len(self.objectives)))
        for posterior in self.objectives:
            posterior.suppose(number)
        return np.array([[posterior.mean[number] for posterior in self.objectives]])


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
