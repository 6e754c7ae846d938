"""The sharp models: Gaussian processes near the front, and what they promise of single points.

An objective may be smooth over its whole range, as a time that grows with the work done, or only where
things go well, as an error that gets rough and then leaps as tracking is lost. So two processes are made for
each: one learns from all values, one from those of points on the front or beside it. The one that foretells
the latter better, each left out in turn, is kept. Where that is the second, what is not beside the front
counts as a failure, and so does what leaps away from all that is around it, or could not be measured: one
more process learns where that is, and so do trees, because a process alone finds gaps between any failures,
and a search looks for just these.

A process of what is beside the front is sharp there and of no use far from it, where it may expect anything.
Hence three opinions: the bold one asks it anywhere, the cautious one only where it is about as sure as among
its own points, and one only beside the front: of fewer points fewer are overrated, and late that is what
wins.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from pareto.errors import StateError
from pareto.gaussian import SHARED, GaussianProcess, Posterior
from pareto.history import History
from pareto.improvement import expected_improvement
from pareto.jury import Jury
from pareto.screening import beside_front
from pareto.space import Indices, Space
from pareto.targets import TINY, Targets
from pareto.transfer import Trend

Array = NDArray[np.float64]
Rows = NDArray[np.int64]
Recipe = dict[str, Any]  # {"near": whether from points near the front alone, "theta": hyperparameters}

SUCCESS = "success"
CAUTIOUS, BOLD, BESIDE = 0, 1, 2  # opinions
LEAST = 10  # points near the front from which it can be told which process foretells better
LEAP = 3.0  # standard deviations by which a near point may be worse than foretold, and still be learnt from
LEAPS = 40  # points near the front from which it can be told which of them leap
TRUST = 2.0  # times its doubt about its own points, from all others: where a near process is to be believed
FRESH = 20  # further points known, after which the trees that judge success are grown anew


class Surrogates:
    """A process for each objective's target and, once there are failures, one for success (1, -1).

    `recipes` tells how each was made, under the objective's number or SUCCESS, in plain JSON. The `jury` has
    its own word on success.
    """

    def __init__(
        self,
        history: History,
        targets: Targets,
        trend: Trend,
        points: int,
        rng: np.random.Generator,
        recipes: Mapping[str, Recipe] | None = None,
        jury: Jury | None = None,
    ) -> None:
        """Learn from at most `points` measurements near the front, and from as many successes and failures.

        The processes learn what `trend` leaves over. For those that `recipes` (of earlier surrogates) has,
        neither the choice nor the hyperparameters are searched for again; and their `jury` stays until FRESH
        further points are known.
        """
        self.space = history.space
        self.targets = targets
        self.recipes: dict[str, Recipe] = {}
        self._trend = trend
        self._rng = rng
        self._given = dict(recipes or {})
        self._near: NDArray[np.bool_] = targets.near()
        self._beside = beside_front(targets, self.space)
        rows = _nearest(targets, points, rng)
        few = self._near[rows].sum() < LEAST
        rest = trend.rest(targets)
        self._objectives = []
        for number, slope in enumerate(trend.slope):
            column = rest[:, number] if slope or few else targets.values[:, number]
            self._objectives.append(self._objective(str(number), rows, column))
        lost = ~self._near & any(learnt.near for learnt in self._objectives)
        for learnt in self._objectives:
            lost[learnt.leapt] = True
        self._success: GaussianProcess | None = None
        self.jury: Jury | None = None
        good, bad = targets.indices[~lost], np.concatenate([history.failed(), targets.indices[lost]])
        if len(bad):
            known = len(jury.good) + len(jury.bad) if jury else 0
            if jury is None or len(good) + len(bad) >= known + FRESH:
                jury = Jury(self.space, good, bad, seed=int(rng.integers(2**31)))
            self.jury = jury
            good, bad = (rng.permutation(indices)[: points // 2] for indices in (good, bad))
            labels = np.concatenate([np.ones(len(good)), -np.ones(len(bad))])
            self._success = self._process(SUCCESS, np.concatenate([good, bad]), labels)
            self.recipes[SUCCESS] = _recipe(self._success, near=False)

    def at(self, indices: Indices) -> Promise:
        """Return what the models say about `indices`."""
        features = self.space.features(indices)
        objectives = [learnt.process.at(features) for learnt in self._objectives]
        chance = np.ones(len(indices))
        if self._success and self.jury:
            success = self._success.at(features)
            chance = ndtr(success.mean / success.spread) * self.jury.chance(indices)
        cautious = chance.copy()
        for learnt, posterior, expected in zip(
            self._objectives, objectives, self._trend(indices).T, strict=True
        ):
            posterior.mean += expected
            cautious *= posterior.spread <= learnt.trusted
        beside = cautious * np.isin(indices, self._beside)
        widest = np.array([learnt.widest for learnt in self._objectives])
        return Promise(indices, objectives, np.stack([cautious, chance, beside]), widest)

    def _objective(self, name: str, rows: Rows, column: Array) -> Learnt:
        """Return the process on all of `rows`, or on the near ones where that one foretells these better."""
        indices, near = self.targets.indices, self._near[rows]
        some, known = rows[near], self._given.get(name)
        if not (known and known["near"]):
            whole = self._process(name, indices[rows], column[rows])
            self.recipes[name] = _recipe(whole, near=False)
            if known or not LEAST <= len(some) < len(rows):
                return Learnt(whole)
        narrow = self._process(name, indices[some], column[some])
        # A few that leap would make all of the process rough: without them it is fitted anew.
        kept = some[narrow.surprise() < LEAP]
        if LEAPS <= len(some) > len(kept):
            narrow = self._process(name, indices[kept], column[kept])
        else:
            kept = some
        if not known and narrow.foretells(np.ones(len(kept), bool)) <= whole.foretells(np.isin(rows, kept)):
            return Learnt(whole)
        self.recipes[name] = _recipe(narrow, near=True)
        spread = max(float(column[kept].std()), TINY)
        leapt = np.setdiff1d(some, kept)
        return Learnt(narrow, near=True, widest=spread, trusted=TRUST * narrow.doubt(), leapt=leapt)

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
    return {"near": bool(recipe["near"]), "theta": theta}


def _recipe(process: GaussianProcess, near: bool) -> Recipe:
    return {"near": near, "theta": process.theta.tolist()}


@dataclass(frozen=True)
class Learnt:
    """The process that foretells an objective.

    If it was made of `near` points alone, its spread counts up to `widest`, the spread of its own targets,
    it is `trusted` where its standard deviation is at most that, and the rows that `leapt` are no part of it.
    """

    process: GaussianProcess
    near: bool = False
    widest: float = np.inf
    trusted: float = np.inf
    leapt: Rows = field(default_factory=lambda: np.empty(0, dtype=np.int64))


@dataclass
class Promise:
    """Posteriors of the objectives at `indices`, and the (opinions, n) `chance` that each is a success.

    Its rows are the CAUTIOUS, the BOLD and the BESIDE opinion. `widest` (objectives) are the largest
    standard deviations that count.
    """

    indices: Indices
    objectives: list[Posterior]
    chance: Array
    widest: Array

    def gain(self, front: Array, reference: Array, rng: np.random.Generator) -> Array:
        """Return (opinions, n) expected improvements, each times the chance to be a success."""
        mean = np.stack([posterior.mean for posterior in self.objectives], axis=1)
        spread = np.stack([posterior.spread for posterior in self.objectives], axis=1)
        spread = np.minimum(spread, self.widest)
        return self.chance * expected_improvement(mean, spread, front, reference, rng)

    def suppose(self, number: int) -> Array:
        """Take point `number` as measured with the values expected, and return these (objectives)."""
        for posterior in self.objectives:
            posterior.suppose(number)
        return np.array([posterior.mean[number] for posterior in self.objectives])


def _nearest(targets: Targets, points: int, rng: np.random.Generator) -> Rows:
    """Return the rows to learn from: all, or mostly those closest to the front and some of the others."""
    if len(targets.values) <= points:
        return np.arange(len(targets.values))
    order = np.argsort(targets.depth, kind="stable")
    near = points * 4 // 5
    return np.concatenate([order[:near], rng.permutation(order[near:])[: points - near]])
