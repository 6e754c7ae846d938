"""The sharp models: Gaussian processes near the front, and what they promise of single points.

An objective may be smooth over its whole range, as a time that grows with the work done, or smooth only
where things go well, as an error that leaps once tracking is lost. So two processes are made for each: one
learns from all values, one from those in reach of the reference alone. The one that foretells the values
within the reference better, each left out in turn, is kept. Where that is the second, what lies out of its
reach counts as a failure, and so does what could not be measured: one more process learns where that is.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

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
Rows = NDArray[np.int64]
Recipe = dict[str, Any]  # {"reach": whether from values in reach alone, "theta": hyperparameters}

SUCCESS = "success"
LEAST = 10  # values within the reference from which it can be told which process foretells better


class Surrogates:
    """A process for each objective's target and, once there are failures, one for success (1, -1).

    `recipes` tells how each was made, under the objective's number or SUCCESS, in plain JSON.
    """

    def __init__(
        self,
        history: History,
        targets: Targets,
        trend: Trend,
        points: int,
        rng: np.random.Generator,
        recipes: Mapping[str, Recipe] | None = None,
    ) -> None:
        """Learn from at most `points` measurements near the front, and from as many successes and failures.

        The processes learn what `trend` leaves over. For those that `recipes` (of earlier surrogates) has,
        neither the choice nor the hyperparameters are searched for again.
        """
        self.space = history.space
        self.targets = targets
        self.recipes: dict[str, Recipe] = {}
        self._trend = trend
        self._rng = rng
        self._given = dict(recipes or {})
        self._within: NDArray[np.bool_] = np.all(targets.values <= targets.reference, axis=1)
        near = _near_the_front(targets, points, rng)
        few = self._within[near].sum() < LEAST
        rest, reached = trend.rest(targets), targets.within_reach()
        lost = np.zeros(len(targets.indices), dtype=bool)
        self._objectives = []
        for number, slope in enumerate(trend.slope):
            column = rest[:, number] if slope or few else targets.values[:, number]
            self._objectives.append(self._objective(str(number), near, column, reached[:, number]))
            if self.recipes[str(number)]["reach"]:
                lost |= ~reached[:, number]
        self._success: GaussianProcess | None = None
        bad = np.concatenate([history.failed(), targets.indices[lost]])
        if len(bad):
            good = rng.permutation(targets.indices[~lost])[: points // 2]
            bad = rng.permutation(bad)[: points // 2]
            labels = np.concatenate([np.ones(len(good)), -np.ones(len(bad))])
            self._success = self._process(SUCCESS, np.concatenate([good, bad]), labels)
            self.recipes[SUCCESS] = _recipe(self._success, reach=False)

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

    def _objective(self, name: str, near: Rows, column: Array, reached: NDArray[np.bool_]) -> GaussianProcess:
        """Return the process on all of `near`, or on those `reached` where that one foretells better."""
        indices, some = self.targets.indices, near[reached[near]]
        if name in self._given:
            reach = bool(self._given[name]["reach"])
            rows = some if reach else near
            chosen = self._process(name, indices[rows], column[rows])
        else:
            reach, chosen = False, self._process(name, indices[near], column[near])
            if len(some) < len(near) and self._within[near].sum() >= LEAST:
                narrow = self._process(name, indices[some], column[some])
                if narrow.foretells(self._within[some]) > chosen.foretells(self._within[near]):
                    reach, chosen = True, narrow
        self.recipes[name] = _recipe(chosen, reach)
        return chosen

    def _process(self, name: str, indices: Indices, column: Array) -> GaussianProcess:
        features, owner = self.space.features(indices), self.space.feature_owner
        if name in self._given:
            return GaussianProcess(features, column, owner, np.array(self._given[name]["theta"]))
        return GaussianProcess.fit(features, column, owner, self._rng)


def _recipe(process: GaussianProcess, reach: bool) -> Recipe:
    return {"reach": reach, "theta": process.theta.tolist()}


@dataclass
class Promise:
    """Posteriors of the objectives at `indices`, and the `chance` that each is a success."""

    indices: Indices
    objectives: list[Posterior]
    chance: Array

    def gain(self, front: Array, reference: Array, rng: np.random.Generator) -> Array:
        """Return the expected improvement of each point times its chance to be a success."""
        mean = np.stack([posterior.mean for posterior in self.objectives], axis=1)
        spread = np.stack([posterior.spread for posterior in self.objectives], axis=1)
        return self.chance * expected_improvement(mean, spread, front, reference, rng)

    def suppose(self, number: int) -> Array:
        """Take point `number` as measured with the values expected, and return these (objectives)."""
        for posterior in self.objectives:
            posterior.suppose(number)
        return np.array([posterior.mean[number] for posterior in self.objectives])


def _near_the_front(targets: Targets, points: int, rng: np.random.Generator) -> Rows:
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
