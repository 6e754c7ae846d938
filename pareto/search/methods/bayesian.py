"""The default method: Gaussian processes, and two expected gains in hypervolume.

The local gain uses the processes near the front, the overall gain the processes of all values. Each proposal
maximises one of them over a common pool: drawn points, the neighbours of the front, and the neighbours of the
best of these as long as they improve.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from pareto.errors import StateError
from pareto.search.candidates import DRAWS, front_neighbours, likely_points, neighbours, pool
from pareto.search.first_repeats import first_repeats
from pareto.search.history import History
from pareto.search.methods.method import ACTIVE, AGAIN, RANDOM, Method
from pareto.search.models import RENEWAL, Learned, Models, read_learned
from pareto.search.repeats import repeat_gains
from pareto.search.targets import FEW, Targets
from pareto.search.trend import Trend, trusted
from pareto.spaces.grid import Indices
from pareto.spaces.sampling import first_design, sample
from pareto.spaces.space import Space, read_index
from pareto.surrogates.success import Success

Array = NDArray[np.float64]
Chosen = list[tuple[int, str]]  # indices, each with its phase

EXPLORE = 14  # one proposal in so many is random at first; see `Bayesian`
CLIMB = 8  # best candidates whose neighbours are evaluated, and how often
AHEAD = 50  # proposals chosen at once, one in so many of the measurements, even if asked for one by one
SHORTLIST = 500  # candidates kept until the next renewal: limits the cost, like the next one
GREEDY = 100  # of a batch that are chosen sequentially
GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0  # the fractions of its multiples are spread evenly


@dataclass
class Bayesian(Method):
    """Expected hypervolume improvement over a pool of candidates.

    `initial` evenly spread configurations come first, the default before all others. By default those are
    FEW, or fewer once half as many succeeded. Then, for each batch: Gaussian processes learn from at most
    `points` measurements near the front, and predict about `candidates` points. The best are taken
    sequentially, each as if those before it had turned out as expected (kriging believer). Where repeats
    differ, or may differ, a configuration is measured again when that is expected to gain more than a new
    one. One in EXPLORE proposals is random instead; that share falls with the root of the number of
    measurements, so exploration becomes rare and never ends. Small batches share a pool and, once there are
    hundreds of measurements, models: a few proposals are chosen ahead.

    With a prior, every second one of the first half of the initial points did well on the other device, as
    long as the measurements here agree. The second half skips points that the other device measured. The
    models learn the residuals of the trend between the two devices.

    What the user expects of parameters guides half of the initial points, and multiplies the gains less and
    less (piBO; see `Models.expected`).
    """

    uses_prior: ClassVar[bool] = True

    initial: int | None = None
    candidates: int = 4000
    points: int = 1000
    _shortlist: list[int] = field(default_factory=list, init=False)
    _learned: Learned = field(default_factory=Learned, init=False)
    _since: int = field(default=0, init=False)  # proposals since both were renewed
    _ahead: Chosen = field(default_factory=list, init=False)  # not yet asked for
    _until: int = field(default=0, init=False)  # the number of results after which both are out of date

    def propose(self, history: History, count: int, rng: np.random.Generator) -> Chosen:
        """Return `count` proposals, or the rest of the space."""
        again = first_repeats(history, count, self.budget)
        chosen = self._new(history, count - len(again), [*again.values()], rng)
        for place, index in again.items():
            chosen.insert(place, (index, AGAIN))
        return chosen

    def _new(self, history: History, count: int, again: list[int], rng: np.random.Generator) -> Chosen:
        """Return `count` proposals beside the first repeats, which are of `again`."""
        taken = history.taken()
        chosen = self._design(history, count, rng)
        count -= len(chosen)
        share = min(1.0, math.sqrt((self.initial or FEW) / max(len(taken), 1))) / EXPLORE
        exploring = int(rng.binomial(count, share)) if count > 0 else 0
        if count > exploring and len(history.measured()[0]):
            best = self._next(history, count - exploring, [*again, *(index for index, _ in chosen)], rng)
            chosen += best
            count -= len(best)
        if count <= 0:
            return chosen
        # Where no candidate has an expected gain, the rest of the batch is random.
        exclude = taken | {index for index, _ in chosen}
        rest = likely_points(history.space, _measurable(history, rng), count, exclude, rng).tolist()
        if not chosen and not rest:
            rest = sample(history.space, count, rng, exclude).tolist()  # an empty batch would end the search
        return chosen + [(index, RANDOM) for index in rest]

    def memory(self) -> dict[str, Any]:
        """Return the state of small batches: the shortlist, the learned models, the proposals chosen
        ahead."""
        return {
            "shortlist": self._shortlist,
            "hyperparameters": self._learned.hyperparameters,
            "success": {name: success.to_dict() for name, success in self._learned.success.items()},
            "since": self._since,
            "ahead": [[index, phase] for index, phase in self._ahead],
            "until": self._until,
        }

    def recall(self, memory: Mapping[str, Any], space: Space) -> None:
        """Restore what `memory` returned."""
        self._shortlist = [read_index(space, index) for index in memory["shortlist"]]
        self._learned = read_learned(memory, space)
        self._since = int(memory["since"])
        self._ahead = [(read_index(space, index), _read_phase(phase)) for index, phase in memory["ahead"]]
        self._until = int(memory["until"])

    def _design(self, history: History, most: int, rng: np.random.Generator) -> Chosen:
        """Return up to `most` initial points; the sequence does not depend on the batch sizes."""
        taken, space = history.taken(), history.space
        first = self.initial or FEW
        if len(taken) >= first or (self.initial is None and 2 * len(history.measured()[0]) >= FEW):
            return []
        prior = self.prior if trusted(history, self.prior) else None
        half = (first + 1) // 2
        default = space.encode(space.default)
        drawn = first_design(space, first - 1, np.random.default_rng(self.seed), {default})
        design = [default, *drawn.tolist()]
        if prior:
            design = design[:half] + [index for index in design[half:] if index not in prior.source.results]
        count = min(len(design) - len(taken), most)
        if count <= 0:
            return []
        proven: list[int] = []
        if prior:
            phases = [*(history.phases | dict(history.pending)).values()]
            wanted = min(len(taken) + count, half) // 2 - phases.count(ACTIVE)
            room = count - (default not in taken)  # the default comes first
            proven = prior.promising(min(wanted, room), taken | {default}).tolist()
        exclude = taken | {*proven}
        design = [index for index in design if index not in exclude][: count - len(proven)]
        missing = count - len(proven) - len(design)
        rest = sample(space, missing, rng, exclude | {*design}, draws=DRAWS).tolist()
        return [(index, RANDOM) for index in [*design, *rest]] + [(index, ACTIVE) for index in proven]

    def _next(self, history: History, count: int, also_taken: list[int], rng: np.random.Generator) -> Chosen:
        """Return the next `count` proposals chosen ahead, or choose again if they are too few or old."""
        taken = history.taken() | set(also_taken)
        gone = {RANDOM: taken, ACTIVE: taken, AGAIN: history.waiting() | set(also_taken)}
        ahead = [(index, phase) for index, phase in self._ahead if index not in gone[phase]]
        if len(ahead) < count or len(taken) >= self._until:
            size = max(count, len(taken) // AHEAD)
            self._until = len(taken) + size
            # BLAS threads slow down work on matrices of a few hundred rows.
            with threadpool_limits(limits=1, user_api="blas"):
                ahead = self._best(history, size, also_taken, rng)
        self._ahead = ahead[count:]
        return ahead[:count]

    def _best(self, history: History, count: int, also_taken: list[int], rng: np.random.Generator) -> Chosen:
        taken = history.taken() | set(also_taken)
        self._since += count
        renewed = self._since > max(RENEWAL, len(taken) // 10) or not self._learned.hyperparameters
        if renewed:
            self._since = count
        targets = Targets.of(history)
        trend = Trend.of(self.prior, targets)
        models = Models(history, targets, trend, self.points, rng, None if renewed else self._learned)
        self._learned = models.learned
        if renewed:
            candidates = pool(targets, history.space, models.measurable, self.candidates, taken, rng)
        else:
            around = rng.permutation(front_neighbours(targets, history.space))[: self.candidates // 2]
            candidates = np.union1d(self._shortlist, around).astype(np.int64)
            candidates = candidates[~np.isin(candidates, np.fromiter(taken, dtype=np.int64))]
        candidates = _climb(models, candidates, taken, max(SHORTLIST, 5 * count), rng)
        self._shortlist = candidates.tolist()
        waiting = np.array([*history.waiting(), *also_taken], dtype=np.int64)
        return _greedy(models, candidates, waiting, count, len(taken), rng)


def _measurable(history: History, rng: np.random.Generator) -> Success | None:
    failed, (succeeded, _) = history.failed(), history.measured()
    if len(failed) == 0 or len(succeeded) == 0:
        return None
    return Success(history.space, succeeded, failed, seed=int(rng.integers(2**31)))


def _read_phase(phase: object) -> str:
    if phase not in (RANDOM, ACTIVE, AGAIN):
        raise StateError(f"the state is damaged: {phase!r} is not a phase of a search")
    return str(phase)


def looks_elsewhere(turn: int, far: float) -> bool:
    """Return whether the overall gain is used: in a share `far` of all turns, evenly spread."""
    return turn * GOLDEN % 1.0 < far


def _climb(
    models: Models, candidates: Indices, taken: set[int], count: int, rng: np.random.Generator
) -> Indices:
    """Return the `count` best of `candidates` and of the neighbours of its best, by descending gain."""
    if not len(candidates):
        return candidates
    front = models.front

    def gains(indices: Indices) -> Array:
        prediction = models.at(indices)
        return np.stack([prediction.local_gain(front, rng), prediction.overall_gain(front, rng)])

    gain = gains(candidates)
    seen = taken | set(candidates.tolist())
    fresh, fresh_gain = candidates, gain
    for _ in range(CLIMB):
        around = neighbours(fresh[_best_of_each(fresh_gain, CLIMB)], models.space)
        around = rng.permutation(around[~np.isin(around, np.fromiter(seen, dtype=np.int64))])[:SHORTLIST]
        if not len(around):
            break
        seen |= set(around.tolist())
        fresh, fresh_gain = around, gains(around)
        better = fresh_gain.max(axis=1) > gain.max(axis=1)
        candidates, gain = np.concatenate([candidates, fresh]), np.concatenate([gain, fresh_gain], axis=1)
        if not better.any():
            break
    return candidates[_best_of_each(gain, count)]


def _best_of_each(gain: Array, count: int) -> NDArray[np.int64]:
    """Return the positions of the `count` best, in turn by each of the (2, n) gains that are not all zero."""
    order = np.argsort(-gain, axis=1, kind="stable")
    promising = np.take_along_axis(gain, order, axis=1) > 0
    ranked = np.concatenate([order.T[promising.T], np.arange(gain.shape[1])])
    _, first = np.unique(ranked, return_index=True)
    return ranked[np.sort(first)[:count]]


def _greedy(
    models: Models, candidates: Indices, waiting: Indices, count: int, turn: int, rng: np.random.Generator
) -> Chosen:
    """Return `count` of `candidates` or of what was measured, each the best if those before are as expected.

    Those `waiting` are pending and are supposed first. The gains alternate, beginning with number `turn`;
    where one is zero everywhere, the other is used. A repeat competes with the local gain, in the same unit.
    """
    front = models.front
    prediction = models.at(np.concatenate([candidates, waiting]))
    free = np.arange(len(prediction.indices)) < len(candidates)
    for number in range(len(candidates), len(candidates) + len(waiting)):
        front = np.vstack([front, prediction.suppose(number)])
    again = repeat_gains(models, waiting.tolist(), rng) * models.expected(models.targets.indices)
    chosen: Chosen = []
    gain = np.zeros(len(free))
    for number in range(min(count, GREEDY)):
        elsewhere = looks_elsewhere(turn + number, models.far)
        for gains in [prediction.overall_gain, prediction.local_gain][:: 1 if elsewhere else -1]:
            gain = np.where(free, gains(front, rng), 0.0)
            if gain.max(initial=0.0) > 0:
                break
        best = gain.max(initial=0.0)
        if again.max(initial=0.0) > best and not elsewhere:
            row = int(np.argmax(again))
            chosen.append((int(models.targets.indices[row]), AGAIN))
            again[row] = 0.0
            continue
        if best <= 0:
            return chosen
        largest = int(np.argmax(gain))
        chosen.append((int(prediction.indices[largest]), ACTIVE))
        front = np.vstack([front, prediction.suppose(largest)])
        free[largest] = False
    # The rest of a huge batch is taken in the order of the last gains.
    gain = np.where(free, gain, 0.0)
    ranked = np.argsort(-gain, kind="stable")[: count - len(chosen)]
    return chosen + [(int(prediction.indices[position]), ACTIVE) for position in ranked if gain[position] > 0]
