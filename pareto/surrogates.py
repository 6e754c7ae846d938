"""The sharp models: Gaussian processes near the front, and what they promise of single points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from pareto.gaussian import GaussianProcess, Posterior
from pareto.history import History
from pareto.improvement import expected_improvement
from pareto.space import Indices
from pareto.targets import Targets
from pareto.transfer import Trend

Array = NDArray[np.float64]
Hyperparameters = list[list[float]]  # plain numbers, so that they can be saved


class Surrogates:
    """A process for each objective's target and, once something failed, one for success (1, -1)."""

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
        chance = np.ones(len(indices))
        if self._success:
            success = self._success.at(features)
            chance = ndtr(success.mean / success.spread)
        return Promise(indices, objectives, chance)

    def _process(self, indices: Indices, column: Array, rng: np.random.Generator) -> GaussianProcess:
        features, owner = self.space.features(indices), self.space.feature_owner
        if self._known:
            return GaussianProcess(features, column, owner, np.array(self._known.pop(0)))
        return GaussianProcess.fit(features, column, owner, rng)


@dataclass
class Promise:
    """Posteriors of the objectives at `indices`, and the `chance` that each can be measured at all."""

    indices: Indices
    objectives: list[Posterior]
    chance: Array

    def gain(self, front: Array, reference: Array, rng: np.random.Generator) -> Array:
        """Return the expected improvement of each point times its chance to be measurable."""
        mean = np.stack([posterior.mean for posterior in self.objectives], axis=1)
        spread = np.stack([posterior.spread for posterior in self.objectives], axis=1)
        return self.chance * expected_improvement(mean, spread, front, reference, rng)

    def suppose(self, number: int) -> Array:
        """Take point `number` as measured with the values expected, and return these (objectives)."""
        for posterior in self.objectives:
            posterior.suppose(number)
        return np.array([posterior.mean[number] for posterior in self.objectives])


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
