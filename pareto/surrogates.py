"""The sharp models: Gaussian processes near the front, and what they promise of single points.

An objective may be smooth over its whole range, as a time that grows with the work done, or smooth only
where things go well, as an error that leaps once tracking is lost. So two processes are made for each: one
learns from all values, one from those in reach of the reference alone. The one that foretells the values
within the reference better, each left out in turn, is kept. Where that is the second, what lies out of its
reach counts as a failure, and so does what could not be measured: one more process learns where that is.

A process of what is in reach is of no use far from it: where everything is lost it expects anything, and the
expected improvement of anything is large. So it is never less sure than its values are spread, and the
process of all values, which has seen what became of the neighbours, is asked too, whether a point is within
the reference. That one may be wrong about whole regions, since it bridges the leap. Hence two opinions: the
cautious one heeds it, the bold one does not.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from pareto.errors import StateError
from pareto.gaussian import SHARED, GaussianProcess, Posterior
from pareto.history import History
from pareto.improvement import expected_improvement
from pareto.space import Indices, Space
from pareto.targets import TINY, Targets
from pareto.transfer import Trend

Array = NDArray[np.float64]
Rows = NDArray[np.int64]
Recipe = dict[str, Any]  # {"reach": whether from values in reach alone, "theta": hyperparameters}

SUCCESS = "success"
CAUTIOUS, BOLD = 0, 1  # opinions on success
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
            learnt = self._objective(str(number), near, column, reached[:, number])
            self._objectives.append(learnt)
            if learnt.judge:
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
        objectives = [learnt.process.at(features) for learnt in self._objectives]
        chance = np.ones(len(indices))
        if self._success:
            success = self._success.at(features)
            chance = ndtr(success.mean / success.spread)
        cautious = chance.copy()
        trend = self._trend(indices).T
        columns = zip(self._objectives, objectives, trend, self.targets.reference, strict=True)
        for learnt, posterior, expected, reference in columns:
            posterior.mean += expected
            if learnt.judge:
                judged = learnt.judge.at(features)
                cautious *= ndtr((reference - judged.mean - expected) / judged.spread)
        widest = np.array([learnt.widest for learnt in self._objectives])
        return Promise(indices, objectives, np.stack([cautious, chance]), widest)

    def _objective(self, name: str, near: Rows, column: Array, reached: NDArray[np.bool_]) -> Learnt:
        """Return the process on all of `near`, or on those `reached` where that one foretells better."""
        indices, some = self.targets.indices, near[reached[near]]
        known, everything = self._given.get(name), f"{name} of all values"
        reach = bool(known and known["reach"])
        whole = self._process(everything if reach or not known else name, indices[near], column[near])
        if reach or (not known and len(some) < len(near) and self._within[near].sum() >= LEAST):
            narrow = self._process(name, indices[some], column[some])
            if reach or narrow.foretells(self._within[some]) > whole.foretells(self._within[near]):
                self.recipes[name], self.recipes[everything] = _recipe(narrow, True), _recipe(whole, False)
                return Learnt(narrow, max(float(column[some].std()), TINY), whole)
        self.recipes[name] = _recipe(whole, False)
        return Learnt(whole)

    def _process(self, name: str, indices: Indices, column: Array) -> GaussianProcess:
        features, owner = self.space.features(indices), self.space.feature_owner
        if name in self._given:
            return GaussianProcess(features, column, owner, np.array(self._given[name]["theta"]))
        return GaussianProcess.fit(features, column, owner, self._rng)


def read_recipe(recipe: Mapping[str, Any], space: Space) -> Recipe:
    """Return a saved recipe for processes on `space`. Raises StateError, KeyError or TypeError otherwise."""
    theta = [float(number) for number in recipe["theta"]]
    if len(theta) != len(space.shape) + SHARED or not np.isfinite(theta).all():
        raise StateError(
            f"the state is damaged: a model has {len(space.shape) + SHARED} finite numbers, not {theta}"
        )
    return {"reach": bool(recipe["reach"]), "theta": theta}


def _recipe(process: GaussianProcess, reach: bool) -> Recipe:
    return {"reach": reach, "theta": process.theta.tolist()}


@dataclass(frozen=True)
class Learnt:
    """The process that foretells an objective.

    Where it was made of values in reach alone, its spread is at most the `widest`, theirs, and the `judge`,
    made of all values, says where the objective is within the reference.
    """

    process: GaussianProcess
    widest: float = np.inf
    judge: GaussianProcess | None = None


@dataclass
class Promise:
    """Posteriors of the objectives at `indices`, and the (2, n) `chance` that each is a success.

    Its rows are the CAUTIOUS and the BOLD opinion. `widest` (objectives) are the largest standard deviations
    that count.
    """

    indices: Indices
    objectives: list[Posterior]
    chance: Array
    widest: Array

    def gain(self, front: Array, reference: Array, rng: np.random.Generator) -> Array:
        """Return (2, n) expected improvements, each times the chance to be a success: CAUTIOUS and BOLD."""
        mean = np.stack([posterior.mean for posterior in self.objectives], axis=1)
        spread = np.stack([posterior.spread for posterior in self.objectives], axis=1)
        spread = np.minimum(spread, self.widest)
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
