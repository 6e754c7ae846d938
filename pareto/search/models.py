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
wins. None of them can tell whether the front goes on somewhere else. That is the fourth's affair, who asks
the processes of all values about its ends. The fifth, the wide one, asks these anywhere, and counts all that
is better than the worst that was measured. It speaks the more, the more of the measured lies far from the
front, because the others then know too little; and not at all where hardly any does.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from pareto.errors import StateError
from pareto.search.ends import beyond_ends
from pareto.search.history import History
from pareto.search.improvement import expected_improvement
from pareto.search.jury import Jury
from pareto.search.screening import beside_front
from pareto.search.targets import TINY, Targets
from pareto.search.transfer import Trend
from pareto.spaces.space import Indices, Space
from pareto.surrogates.gaussian import SHARED, GaussianProcess, Posterior

Array = NDArray[np.float64]
Rows = NDArray[np.int64]
Recipe = list[float]  # hyperparameters of a process

SUCCESS, MEASURABLE = "success", "measurable"
CAUTIOUS, BOLD, BESIDE, ENDS, WIDE = 0, 1, 2, 3, 4  # opinions
LARGEST = 100.0  # hyperparameter, a logarithm, that a saved recipe may have: no search for them ends near it
LEAST = 10  # points near the front from which it can be told which process foretells better
LEAP = 3.0  # standard deviations by which a near point may be worse than foretold, and still be learnt from
LEAPS = 40  # points near the front from which it can be told which of them leap
SMALL = 1 / 3  # share of the measured that lies far from the front: no reason for the WIDE opinion to speak
TRUST = 2.0  # times its doubt about its own points, from all others: where a near process is to be believed
FRESH = 20  # further points known, after which the trees that judge success are grown anew


class Surrogates:
    """Processes for each objective's target and, once there are failures, one for success (1, -1).

    `recipes` tells how each was made: under the objective's number that of all values, under `near_name` that
    of the near points where it was the better one, and under SUCCESS. The `juries` have their own word on
    SUCCESS, and alone on what is MEASURABLE.
    """

    def __init__(
        self,
        history: History,
        targets: Targets,
        trend: Trend,
        points: int,
        rng: np.random.Generator,
        recipes: Mapping[str, Recipe] | None = None,
        juries: Mapping[str, Jury] | None = None,
    ) -> None:
        """Learn from at most `points` measurements near the front, and from as many successes and failures.

        The processes learn what `trend` leaves over. For those that `recipes` (of earlier surrogates) has,
        neither the choice nor the hyperparameters are searched for again; and their `juries` stay until FRESH
        further points are known.
        """
        self.space = history.space
        self.targets = targets
        self.recipes: dict[str, Recipe] = {}
        self.juries: dict[str, Jury] = {}
        self._trend = trend
        self._rng = rng
        self._given = dict(recipes or {})
        self._earlier = dict(juries or {})
        self._near: NDArray[np.bool_] = targets.near()
        self._beside = beside_front(targets, self.space)
        rows = _nearest(targets, points, rng)
        few = self._near[rows].sum() < LEAST
        rest = trend.rest(targets)
        self._objectives = []
        for number, slope in enumerate(trend.slope):
            column = rest[:, number] if slope or few else targets.values[:, number]
            self._objectives.append(self._objective(number, rows, column))
        lost = ~self._near & any(learnt.near for learnt in self._objectives)
        for learnt in self._objectives:
            lost[learnt.leapt] = True
        failed = history.failed()
        good, bad = targets.indices[~lost], np.concatenate([failed, targets.indices[lost]])
        if len(failed):
            self.juries[MEASURABLE] = self._jury(MEASURABLE, targets.indices, failed)
        self._success: GaussianProcess | None = None
        if len(bad):
            self.juries[SUCCESS] = self._jury(SUCCESS, good, bad)
            good, bad = (rng.permutation(indices)[: points // 2] for indices in (good, bad))
            labels = np.concatenate([np.ones(len(good)), -np.ones(len(bad))])
            self._success = self._process(SUCCESS, np.concatenate([good, bad]), labels)

    @property
    def far(self) -> float:
        """The share of what was measured that lies neither on the front nor beside it; 0 while it is small.

        It tells how much of what is proposed falls far from where it was expected.
        """
        far = 1.0 - float(self._near.mean())
        return far if far > SMALL else 0.0

    def at(self, indices: Indices) -> Promise:
        """Return what the models say about `indices`."""
        features = self.space.features(indices)
        objectives = [learnt.process.at(features) for learnt in self._objectives]
        overall = {
            number: learnt.overall.at(features)
            for number, learnt in enumerate(self._objectives)
            if learnt.near
        }
        chance, measurable = np.ones(len(indices)), np.ones(len(indices))
        if self._success:
            success = self._success.at(features)
            chance = ndtr(success.mean / success.spread) * self.juries[SUCCESS].chance(indices)
        if MEASURABLE in self.juries:
            measurable = self.juries[MEASURABLE].chance(indices)
        cautious = chance.copy()
        for number, expected in enumerate(self._trend(indices).T):
            objectives[number].mean += expected
            if number in overall:
                overall[number].mean += expected
            cautious *= objectives[number].spread <= self._objectives[number].trusted
        beside = cautious * np.isin(indices, self._beside)
        widest = np.array([learnt.widest for learnt in self._objectives])
        wide = measurable * (self.far > 0)
        chances = np.stack([cautious, chance, beside, measurable, wide])
        return Promise(indices, self.targets, objectives, overall, chances, widest)

    def _objective(self, number: int, rows: Rows, column: Array) -> Learnt:
        """Return the process on all of `rows`, or on the near ones where that one foretells these better."""
        indices, near = self.targets.indices, self._near[rows]
        some, name = rows[near], str(number)
        overall = self._process(name, indices[rows], column[rows])
        known = name in self._given
        if near_name(number) not in self._given and (known or not LEAST <= len(some) < len(rows)):
            return Learnt(overall, overall)
        narrow = self._process(near_name(number), indices[some], column[some])
        # A few that leap would make all of the process rough: without them it is fitted anew.
        kept = some[narrow.surprise() < LEAP]
        if LEAPS <= len(some) > len(kept):
            narrow = self._process(near_name(number), indices[kept], column[kept])
        else:
            kept = some
        if not known and narrow.foretells(np.ones(len(kept), bool)) <= overall.foretells(np.isin(rows, kept)):
            del self.recipes[near_name(number)]
            return Learnt(overall, overall)
        spread = max(float(column[kept].std()), TINY)
        leapt = np.setdiff1d(some, kept)
        return Learnt(narrow, overall, True, widest=spread, trusted=TRUST * narrow.doubt(), leapt=leapt)

    def _process(self, name: str, indices: Indices, column: Array) -> GaussianProcess:
        """Return a process by the recipe that was given, or by one that is searched for; and note it."""
        features, owner = self.space.features(indices), self.space.feature_owner
        if name in self._given:
            process = GaussianProcess(features, column, owner, np.array(self._given[name]))
        else:
            process = GaussianProcess.fit(features, column, owner, self._rng)
        self.recipes[name] = process.theta.tolist()
        return process

    def _jury(self, name: str, good: Indices, bad: Indices) -> Jury:
        earlier = self._earlier.get(name)
        if earlier and len(good) + len(bad) < len(earlier.good) + len(earlier.bad) + FRESH:
            return earlier
        return Jury(self.space, good, bad, seed=int(self._rng.integers(2**31)))


def near_name(number: int) -> str:
    """Return the name of the process that learns an objective from points near the front alone."""
    return f"{number} near"


def read_recipe(recipe: Iterable[float], space: Space) -> Recipe:
    """Return a saved recipe for processes on `space`. Raises StateError or TypeError otherwise."""
    theta = [float(number) for number in recipe]
    count = len(space.shape) + SHARED
    if len(theta) != count or not (np.abs(theta) < LARGEST).all():
        raise StateError(f"the state is damaged: a model has {count} numbers below {LARGEST:g}, not {theta}")
    return theta


@dataclass(frozen=True)
class Learnt:
    """The process that foretells an objective, and the `overall` one, of all values: often the same.

    If it was made of `near` points alone, its spread counts up to `widest`, the spread of its own targets,
    it is `trusted` where its standard deviation is at most that, and the rows that `leapt` are no part of it.
    """

    process: GaussianProcess
    overall: GaussianProcess
    near: bool = False
    widest: float = np.inf
    trusted: float = np.inf
    leapt: Rows = field(default_factory=lambda: np.empty(0, dtype=np.int64))


@dataclass
class Promise:
    """Posteriors of the objectives at `indices`, and the (opinions, n) `chance` that each is a success.

    Its rows are the opinions, CAUTIOUS to WIDE. The last two ask processes of all values: the `overall`
    posterior of those objectives, by number, whose other one knows near points alone. `widest` (objectives)
    are the largest standard deviations that count.
    """

    indices: Indices
    targets: Targets
    objectives: list[Posterior]
    overall: dict[int, Posterior]
    chance: Array
    widest: Array

    def gains(self, front: Array, rng: np.random.Generator) -> Array:
        """Return the (opinions, n) `gain` of each opinion."""
        near = self._near(front, rng)
        wide = self._wide(front, rng) if self.chance[WIDE].any() else np.zeros(len(near))
        return self.chance * np.stack([near, near, near, self._ends(front), wide])

    def gain(self, opinion: int, front: Array, rng: np.random.Generator) -> Array:
        """Return the (n,) expected gains over `front`, each times the chance to be a success.

        Those are of hypervolume, that of ENDS is how far beyond the front's ends, in shares of the range.
        """
        if opinion == ENDS:
            return self.chance[opinion] * self._ends(front)
        return self.chance[opinion] * (self._wide if opinion == WIDE else self._near)(front, rng)

    def _near(self, front: Array, rng: np.random.Generator) -> Array:
        mean, spread = _moments(self.objectives)
        return expected_improvement(mean, np.minimum(spread, self.widest), front, self.targets.reference, rng)

    def _ends(self, front: Array) -> Array:
        limits = self.targets.limits
        least = np.vstack([front[(front <= limits).all(axis=1)], self.targets.reference]).min(axis=0)
        return beyond_ends(*_moments(self._of_all_values()), least, limits, self.targets.range)

    def _wide(self, front: Array, rng: np.random.Generator) -> Array:
        known = np.vstack([front, self.targets.whole_front])
        return expected_improvement(*_moments(self._of_all_values()), known, self.targets.worst, rng)

    def _of_all_values(self) -> list[Posterior]:
        return [self.overall.get(number, near) for number, near in enumerate(self.objectives)]

    def suppose(self, number: int) -> Array:
        """Take point `number` as measured with the values expected, and return these (objectives)."""
        for posterior in [*self.objectives, *self.overall.values()]:
            posterior.suppose(number)
        return np.array([posterior.mean[number] for posterior in self.objectives])


def _moments(posteriors: list[Posterior]) -> tuple[Array, Array]:
    """Return the (n, objectives) means and standard deviations."""
    mean = np.stack([posterior.mean for posterior in posteriors], axis=1)
    return mean, np.stack([posterior.spread for posterior in posteriors], axis=1)


def _nearest(targets: Targets, points: int, rng: np.random.Generator) -> Rows:
    """Return the rows to learn from: all, or mostly those closest to the front and some of the others."""
    if len(targets.values) <= points:
        return np.arange(len(targets.values))
    order = np.argsort(targets.depth, kind="stable")
    near = points * 4 // 5
    return np.concatenate([order[:near], rng.permutation(order[near:])[: points - near]])
