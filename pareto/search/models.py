"""The models of a search: Gaussian processes for each objective, near the front and overall, and for success.

An objective may be smooth over its whole range, such as a time that grows with the work, or only in a part of
it, such as an error that jumps when tracking is lost. So two Gaussian processes are fitted for each: the
overall one to all values, the local one to points on or near the front. The one that predicts the latter
better (leave-one-out) is kept. Where that is the local one, a point that is not near the front counts as a
failure. So does an outlier from all its neighbours, or a point that could not be measured. A point with a
censored value always counts as a failure, and the overall process learns its expected value beyond the bound.
Another process and trees learn where failures are: a process alone leaves gaps between failures, which a
search would exploit.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from pareto.errors import StateError
from pareto.search.acquisition import expected_improvement
from pareto.search.history import History
from pareto.search.noise import Noise
from pareto.search.targets import FEW, TINY, Targets
from pareto.search.trend import Trend
from pareto.spaces.grid import Indices
from pareto.spaces.space import Space
from pareto.surrogates.gaussian import SHARED, GaussianProcess, Posterior
from pareto.surrogates.success import Success

Array = NDArray[np.float64]
Rows = NDArray[np.int64]
Hyperparameters = list[float]  # of a process

NEAR, MEASURABLE = "near", "measurable"
LARGEST = 100.0  # largest hyperparameter, a logarithm, of a valid state; fitted ones are far smaller
LEAP = 3.0  # standard deviations above its prediction from which a near point is an outlier
SMALL = 1 / 3  # share of measured points far from the front that is still ignored
TRUST = 10.0  # exponent of the user's weights for the first proposal that was learned
RENEWAL = 20  # further points, after which trees are grown again


@dataclass(frozen=True)
class Learned:
    """The fitted hyperparameters and trees by name, which the next models reuse.

    A process is named by its objective's number, followed by `near` for a local one.
    """

    hyperparameters: dict[str, Hyperparameters] = field(default_factory=dict)
    success: dict[str, Success] = field(default_factory=dict)


@dataclass(frozen=True)
class ObjectiveModels:
    """The local process of an objective, and the overall one; one object where both predict equally well.

    A local standard deviation is capped at `widest`, that of its targets. `rows` numbers the targets of the
    local one, `leapt` its outliers.
    """

    local: GaussianProcess
    overall: GaussianProcess
    rows: Rows
    widest: float = np.inf
    leapt: Rows = field(default_factory=lambda: np.empty(0, dtype=np.int64))

    @property
    def is_local(self) -> bool:
        """Whether points near the front have a separate process."""
        return self.local is not self.overall


class Models:
    """The processes of each objective's target, and of success near the front."""

    def __init__(
        self,
        history: History,
        targets: Targets,
        trend: Trend,
        points: int,
        rng: np.random.Generator,
        earlier: Learned | None = None,
    ) -> None:
        """Learn from at most `points` measurements near the front, and from as many successes and failures.

        The processes learn the residuals of `trend`. Hyperparameters of `earlier` models are reused.
        """
        self.space = history.space
        self.targets = targets
        self.noise = Noise.of(history, targets)
        self.counts, self.attempts = history.counts(), history.attempts()
        self.learned = Learned()
        self._trust = TRUST / (1 + sum(phase != "random" for phase in history.phases.values()))
        self._trend = trend
        self._rng = rng
        self._earlier = earlier or Learned()
        self._near = targets.near()
        rows = _nearest(targets, points, rng)
        few = self._near[rows].sum() * 4 < FEW
        rest, room = trend.rest(targets), targets.reach - targets.winsorised()
        self.objectives = []
        for number, slope in enumerate(trend.slope):
            column, ceiling = targets.values[:, number], np.full(len(rest), np.inf)
            if slope or few:
                column, ceiling = rest[:, number], rest[:, number] + room[:, number]
            self.objectives.append(self._objective(number, rows, column, ceiling))
        lost = ~self._near & any(objective.is_local for objective in self.objectives)
        lost |= ~targets.exact
        for objective in self.objectives:
            lost[objective.leapt] = True
        failed = history.failed()
        self.measurable = self._success(MEASURABLE, targets.indices, failed)
        good, bad = targets.indices[~lost], np.concatenate([failed, targets.indices[lost]])
        self._near_trees = self._success(NEAR, good, bad)
        self._near_process: GaussianProcess | None = None
        if len(bad):
            good, bad = (rng.permutation(indices)[: points // 2] for indices in (good, bad))
            labels = np.concatenate([np.ones(len(good)), -np.ones(len(bad))])
            self._near_process = self._process(NEAR, np.concatenate([good, bad]), labels)

    @property
    def far(self) -> float:
        """The share of measured points that are not near the front; 0 while it is small.

        It estimates how many proposals miss their predicted values by far.
        """
        far = 1.0 - float(self._near.mean())
        return far if far > SMALL else 0.0

    @cached_property
    def front(self) -> Array:
        """The (points, objectives) non-dominated posterior means within the reference, none censored."""
        expected, _ = self.estimates
        return expected[self.targets.front_of(expected)]

    @cached_property
    def estimates(self) -> tuple[Array, Array]:
        """The (n, objectives) posterior means of measured points, without noise, and their deviations.

        Without known noise, and where no process learned a point, they are the measurements themselves.
        """
        mean, deviation = self.targets.values.copy(), np.zeros_like(self.targets.values)
        for number, objective in enumerate(self.objectives):
            errors = self.variance(number) / self.counts
            if not errors.any():
                continue
            deviation[:, number] = np.sqrt(errors)
            rows = objective.rows
            truth, deviation[rows, number] = objective.local.truth(errors[rows])
            mean[rows, number] += truth - objective.local.targets
        return mean, deviation

    def variance(self, number: int) -> Array:
        """Return the (n,) variances of one measurement of an objective."""
        return self.noise.expected(number, self.objectives[number].local.nugget)

    def expected(self, indices: Indices) -> Array:
        """Return the (n,) user's weights of `indices`, which count less with each measurement after the first
        design: raised to TRUST / n (Hvarfner et al. 2022, eq. 6)."""
        return self.space.weights(indices) ** self._trust

    def at(self, indices: Indices) -> Prediction:
        """Return the models' predictions at `indices`, the chances times the user's weights."""
        features = self.space.features(indices)
        near = np.ones(len(indices))
        if self._near_process and self._near_trees:
            success = self._near_process.at(features)
            near = ndtr(success.mean / success.spread) * self._near_trees.chance(indices)
        measurable = np.ones(len(indices)) if self.measurable is None else self.measurable.chance(indices)
        weights = self.expected(indices)
        near, measurable = near * weights, measurable * weights
        local, overall = [], []
        for objective, expected in zip(self.objectives, self._trend(indices).T, strict=True):
            local.append(objective.local.at(features))
            overall.append(objective.overall.at(features) if objective.is_local else local[-1])
            for posterior in {id(item): item for item in (local[-1], overall[-1])}.values():
                posterior.mean += expected
        widest = np.array([objective.widest for objective in self.objectives])
        return Prediction(indices, self.targets, local, overall, near, measurable * (self.far > 0), widest)

    def _objective(self, number: int, rows: Rows, column: Array, ceiling: Array) -> ObjectiveModels:
        """Return the process on all of `rows`, and one on the near ones where that predicts these better.

        Censored targets of `column` (n) are taken for larger ones, up to `ceiling` (n).
        """
        indices, censored = self.targets.indices, self.targets.censored[rows, number]
        if censored.all():  # bounds alone are learned as they are
            censored = np.zeros(len(rows), bool)
        every, rows, beyond = rows, rows[~censored], rows[censored]
        name, local_name = str(number), f"{number} {NEAR}"
        theta = None
        if len(beyond) and len(rows) * 4 < FEW:  # with so few values, bounds help more than they mislead
            theta = self._process(name, indices[every], column[every]).theta
        overall = self._process(name, indices[rows], column[rows], rows, theta)
        if len(beyond):
            features = self.space.features(indices[beyond])
            overall = overall.with_censored(features, column[beyond], ceiling[beyond])
            rows = np.concatenate([rows, beyond])
        some = rows[self._near[rows]]
        fitted_before = name in self._earlier.hyperparameters
        few = len(some) * 4 < FEW or len(some) == len(rows)
        if not len(some) or (local_name not in self._earlier.hyperparameters and (fitted_before or few)):
            return ObjectiveModels(overall, overall, rows)
        local = self._process(local_name, indices[some], column[some], some)
        # A few outliers would make the whole process rough: it is fitted again without them.
        kept = some[local.excess() < LEAP]
        if FEW <= len(some) > len(kept):
            local = self._process(local_name, indices[kept], column[kept], kept)
        else:
            kept = some
        mine = local.log_density(np.ones(len(kept), bool))
        if not fitted_before and mine <= overall.log_density(np.isin(rows, kept)):
            del self.learned.hyperparameters[local_name]
            return ObjectiveModels(overall, overall, rows)
        widest = max(float(column[kept].std()), TINY)
        return ObjectiveModels(local, overall, kept, widest, np.setdiff1d(some, kept))

    def _process(
        self,
        name: str,
        indices: Indices,
        column: Array,
        rows: Rows | None = None,
        theta: Array | None = None,
    ) -> GaussianProcess:
        """Return a process with hyperparameters `theta`, or earlier ones, or fitted ones.

        `rows` numbers the targets that may be means of repeated measurements.
        """
        features, owner = self.space.features(indices), self.space.feature_owner
        if theta is None and name in self._earlier.hyperparameters:
            theta = np.array(self._earlier.hyperparameters[name])
        if theta is not None:
            process = GaussianProcess(features, column, owner, theta)
        else:
            process = GaussianProcess.fit(features, column, owner, self._rng)
        self.learned.hyperparameters[name] = process.theta.tolist()
        if rows is not None and self.noise:
            variance = self.noise.expected(int(name.split()[0]), process.nugget)[rows]
            process = GaussianProcess(
                features, column, owner, process.theta, float(variance.mean()), variance / self.counts[rows]
            )
        return process

    def _success(self, name: str, good: Indices, bad: Indices) -> Success | None:
        if not len(bad):
            return None
        success = self._earlier.success.get(name)
        if success is None or len(good) + len(bad) >= len(success) + RENEWAL:
            success = Success(self.space, good, bad, seed=int(self._rng.integers(2**31)))
        self.learned.success[name] = success
        return success


@dataclass
class Prediction:
    """Posteriors at `indices`: of the local processes and of the overall ones, often the same objects.

    `near` (n) are the probabilities of success for the local ones, `measurable` (n) those for the overall
    ones, zero where these are not used. `widest` (objectives) caps the deviations.
    """

    indices: Indices
    targets: Targets
    local: list[Posterior]
    overall: list[Posterior]
    near: Array
    measurable: Array
    widest: Array

    def local_gain(self, front: Array, rng: np.random.Generator) -> Array:
        """Return the (n,) expected gain in hypervolume over `front`, times the chance of a success."""
        mean, spread = _moments(self.local)
        spread = np.minimum(spread, self.widest)
        return self.near * expected_improvement(mean, spread, front, self.targets.reference, rng)

    def overall_gain(self, front: Array, rng: np.random.Generator) -> Array:
        """Return the (n,) expected gain below the worst that was measured, times the chance to succeed.

        Every improvement counts: where the front may go on, its useful end is unknown.
        """
        if not self.measurable.any():
            return np.zeros(len(self.indices))
        combined = np.vstack([front, self.targets.whole_front])
        mean, spread = _moments(self.overall)
        return self.measurable * expected_improvement(mean, spread, combined, self.targets.worst, rng)

    def suppose(self, number: int) -> Array:
        """Condition on point `number` having its expected values, and return them (objectives)."""
        for posterior in {id(item): item for item in [*self.local, *self.overall]}.values():
            posterior.suppose(number)
        return np.array([posterior.mean[number] for posterior in self.local])


def read_hyperparameters(numbers: Iterable[float], space: Space) -> Hyperparameters:
    """Return saved hyperparameters for processes on `space`. Raises StateError or TypeError otherwise."""
    theta = [float(number) for number in numbers]
    count = len(space.shape) + SHARED
    if len(theta) != count or not (np.abs(theta) < LARGEST).all():
        raise StateError(f"the state is damaged: a model has {count} numbers below {LARGEST:g}, not {theta}")
    return theta


def read_learned(saved: Mapping[str, Mapping[str, Any]], space: Space) -> Learned:
    """Return a saved `Learned`. Raises StateError, KeyError or TypeError where it is damaged."""
    return Learned(
        {str(name): read_hyperparameters(theta, space) for name, theta in saved["hyperparameters"].items()},
        {str(name): Success.read(success, space) for name, success in saved["success"].items()},
    )


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
