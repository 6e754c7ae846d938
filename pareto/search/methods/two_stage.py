"""The default method: trees screen the whole space, Gaussian processes decide near the front."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from pareto.search.exploration import explored
from pareto.search.history import History, read_index
from pareto.search.jury import Jury
from pareto.search.methods.method import ACTIVE, RANDOM, Method
from pareto.search.models import BESIDE, BOLD, CAUTIOUS, ENDS, WIDE, Recipe, Surrogates, read_recipe
from pareto.search.screening import DRAWS, beside_front, candidates, free_points, screen
from pareto.search.targets import Targets
from pareto.search.transfer import Trend, trusted
from pareto.spaces.sampling import sample, spread_sample
from pareto.spaces.space import Indices, Space

FIRST = 40  # evenly spread configurations to learn from, unless `initial` says how many
SUFFICIENT = 20  # successes, after which no more of them are measured then
SHORTLIST = 500  # candidates that stay in the race after the first look
RENEWAL = 20  # proposals, at least, after which the space is screened and the models are chosen anew
SELDOM = 10  # one in so many of the measurements: proposals after which they are, late
AHEAD = 50  # one in so many of the measurements: proposals that are chosen at once, though asked for singly
GREEDY = 100  # of a batch that are chosen one after the other
TURNS = (ENDS, *(BOLD, BESIDE, CAUTIOUS) * 4)  # whose opinion decides, where it is not the WIDE one
GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0  # the fractions of its multiples are spread evenly
NEIGHBOURS = 250  # of the front that are looked at for each proposal of a batch between two screenings
CLIMBERS = 8  # best candidates whose neighbours are looked at, too
CLIMBS = 8  # times at most


@dataclass
class TwoStage(Method):
    """Expected hypervolume improvement over a screened pool.

    `initial` evenly spread configurations come first, the default before all others. Where it is not given,
    those are FIRST, and no more once SUFFICIENT of them succeeded. Then each batch: `trees` extra trees on
    log targets predict the whole space; about `candidates` points near the predicted front, around the
    measured one and from anywhere within the reference go to Gaussian processes fitted to at most `points`
    measurements near the front, and so do the neighbours of the best of them, as long as that finds better
    ones; points are taken greedily by expected hypervolume improvement times the chance of success, one in
    thirteen by how far it may be beyond the front's ends, and where much of what was measured lies far from
    the front, such a share by what processes of all values expect. At first one in `explore` is drawn at
    random instead, mostly of what may be expected not to fail; that share falls with the root of what was
    measured, so that exploration gets rare and never dries up. Small batches share a screening and, once
    there are hundreds of measurements, models: a few proposals are chosen ahead.

    With a prior, every other of the first half of the initial ones is one that did well on the other device,
    while that is borne out, and of the second half those are left out that it measured; the models learn what
    the trend between the two devices leaves over.
    """

    uses_prior: ClassVar[bool] = True

    initial: int | None = None
    trees: int = 32
    candidates: int = 4000
    points: int = 1000
    explore: int = 14
    _shortlist: list[int] = field(default_factory=list, init=False)
    _recipes: dict[str, Recipe] = field(default_factory=dict, init=False)
    _juries: dict[str, Jury] = field(default_factory=dict, init=False)
    _since: int = field(default=0, init=False)  # proposals from both
    _ahead: list[int] = field(default_factory=list, init=False)  # chosen, and not yet asked for
    _until: int = field(default=0, init=False)  # so many are taken: those are out of date

    def propose(self, history: History, count: int, rng: np.random.Generator) -> list[tuple[int, str]]:
        """Return `count` proposals, or what is left of the space."""
        taken = history.taken()
        chosen = self._first(history, count, rng)
        count -= len(chosen)
        share = min(1.0, math.sqrt((self.initial or FIRST) / max(len(taken), 1))) / self.explore
        exploring = int(rng.binomial(count, share)) if count > 0 else 0
        if count > exploring and len(history.measured()[0]):
            best = self._next(history, count - exploring, [index for index, _ in chosen], rng)
            chosen += [(index, ACTIVE) for index in best]
            count -= len(best)
        # Where no candidate promises anything, the rest of the batch explores.
        exclude = taken | {index for index, _ in chosen}
        rest = explored(history, max(count, 0), exclude, rng)
        if not chosen and not len(rest):
            rest = sample(history.space, count, rng, exclude)  # to propose nothing ends a search: longer
        return chosen + [(index, RANDOM) for index in rest.tolist()]

    def memory(self) -> dict[str, Any]:
        """Return what small batches share: the present shortlist, the models' recipes and the juries."""
        return {
            "shortlist": self._shortlist,
            "recipes": self._recipes,
            "juries": {name: jury.to_dict() for name, jury in self._juries.items()},
            "since": self._since,
            "ahead": self._ahead,
            "until": self._until,
        }

    def recall(self, memory: Mapping[str, Any], space: Space) -> None:
        """Take back what `memory` returned; without it, the next batch screens the space anew."""
        self._shortlist = [read_index(space, index) for index in memory.get("shortlist", [])]
        recipes = memory.get("recipes", {})
        # Those of earlier programs have another form: the next batch screens the space anew.
        if all(isinstance(recipe, list) for recipe in recipes.values()):
            self._recipes = {str(name): read_recipe(recipe, space) for name, recipe in recipes.items()}
        juries = memory.get("juries", {})
        self._juries = {str(name): Jury.read(jury, space) for name, jury in juries.items()}
        self._since = int(memory.get("since", 0))
        self._ahead = [read_index(space, index) for index in memory.get("ahead", [])]
        self._until = int(memory.get("until", 0))

    def _first(self, history: History, most: int, rng: np.random.Generator) -> list[tuple[int, str]]:
        """Return up to `most` of what comes first, the same however small the portions it is asked for in."""
        taken, space = history.taken(), history.space
        first = self.initial or FIRST
        if len(taken) >= first or (self.initial is None and len(history.measured()[0]) >= SUFFICIENT):
            return []
        prior = history.prior if trusted(history) else None
        half = (first + 1) // 2
        default = space.encode(space.default)
        drawn = spread_sample(space, first - 1, np.random.default_rng(self.seed), {default})
        design = [default, *drawn.tolist()]
        if prior:
            design = design[:half] + [index for index in design[half:] if index not in prior.source.told]
        count = min(len(design) - len(taken), most)
        if count <= 0:
            return []
        proven: list[int] = []
        if prior:
            phases = [*(history.phases | history.pending).values()]
            wanted = min(len(taken) + count, half) // 2 - phases.count(ACTIVE)
            room = count - (default not in taken)  # which comes before all others
            proven = prior.promising(min(wanted, room), taken | {default}).tolist()
        exclude = taken | {*proven}
        design = [index for index in design if index not in exclude][: count - len(proven)]
        missing = count - len(proven) - len(design)
        rest = sample(space, missing, rng, exclude | {*design}, draws=DRAWS).tolist()
        return [(index, RANDOM) for index in [*design, *rest]] + [(index, ACTIVE) for index in proven]

    def _next(
        self, history: History, count: int, also_taken: list[int], rng: np.random.Generator
    ) -> list[int]:
        """Return the next `count` of those chosen ahead, or choose anew where they are too few or too old."""
        taken = history.taken() | set(also_taken)
        ahead = [index for index in self._ahead if index not in taken]
        if len(ahead) < count or len(taken) >= self._until:
            size = max(count, len(taken) // AHEAD)
            self._until = len(taken) + size
            # On matrices of a few hundred rows, threads of BLAS cost six times what they save.
            with threadpool_limits(limits=1, user_api="blas"):
                ahead = self._best(history, size, also_taken, rng)
        self._ahead = ahead[count:]
        return ahead[:count]

    def _best(
        self, history: History, count: int, also_taken: list[int], rng: np.random.Generator
    ) -> list[int]:
        taken = history.taken() | set(also_taken)
        self._since += count
        renewed = self._since > max(RENEWAL, len(taken) // SELDOM) or not self._recipes
        if renewed:
            self._since = count
        targets = Targets.of(history)
        trend = Trend.of(history, targets)
        if renewed:
            found = free_points(history, targets, rng)
            if len(found) > self.candidates:
                screening = screen(history, targets, trend, found, self.trees, rng)
                found = candidates(screening, targets, history.space, self.candidates, rng)
            surrogates = Surrogates(history, targets, trend, self.points, rng)
        else:
            around = rng.permutation(beside_front(targets, history.space))
            around = around[: min(self.candidates, max(SHORTLIST, NEIGHBOURS * count))]
            found = np.union1d(self._shortlist, around).astype(np.int64)
            surrogates = Surrogates(history, targets, trend, self.points, rng, self._recipes, self._juries)
        found = found[~np.isin(found, np.fromiter(taken, dtype=np.int64))]
        if len(found) == 0:
            return []
        found = _shortlist(surrogates, found, taken, max(SHORTLIST, 5 * count), rng)
        self._shortlist, self._recipes, self._juries = found.tolist(), surrogates.recipes, surrogates.juries
        waiting = np.array([*history.pending, *also_taken], dtype=np.int64)
        return _greedy(surrogates, found, waiting, count, len(taken), rng)


def whose_turn(turn: int, far: float) -> int:
    """Return the opinion that decides: the WIDE one in a share `far` of all turns, else one of TURNS."""
    return WIDE if turn * GOLDEN % 1.0 < far else TURNS[turn % len(TURNS)]


def _shortlist(
    surrogates: Surrogates, found: Indices, taken: set[int], count: int, rng: np.random.Generator
) -> Indices:
    """Return the `count` of `found`, and of the neighbours of the best, that promise most, best first."""
    targets, space = surrogates.targets, surrogates.space
    front = targets.values[targets.front]
    gain = surrogates.at(found).gains(front, rng)
    seen = taken | set(found.tolist())
    fresh, fresh_gain = found, gain
    for _ in range(CLIMBS):
        best = fresh[_tops(fresh_gain, CLIMBERS)].tolist()
        around = sorted({index for top in best for index in space.neighbours(top).tolist()} - seen)
        if not around:
            break
        fresh = rng.permutation(np.array(around, dtype=np.int64))[:SHORTLIST]
        seen |= set(fresh.tolist())
        fresh_gain = surrogates.at(fresh).gains(front, rng)
        better = fresh_gain.max(axis=1) > gain.max(axis=1, initial=0.0)
        found, gain = np.concatenate([found, fresh]), np.concatenate([gain, fresh_gain], axis=1)
        if not better.any():
            break
    return found[_tops(gain, count)]


def _tops(gain: NDArray[np.float64], count: int) -> NDArray[np.int64]:
    """Return the positions of the `count` best, in turn by each opinion that sees something to gain there."""
    order = np.argsort(-gain, axis=1, kind="stable")
    promising = np.take_along_axis(gain, order, axis=1) > 0
    ranked = np.concatenate([order.T[promising.T], np.arange(gain.shape[1])])
    _, first = np.unique(ranked, return_index=True)
    return ranked[np.sort(first)[:count]]


def _greedy(
    surrogates: Surrogates,
    found: Indices,
    waiting: Indices,
    count: int,
    turn: int,
    rng: np.random.Generator,
) -> list[int]:
    """Return `count` of `found`, each the best once those before it turn out as expected.

    Those `waiting` are under way already and are supposed first. The opinions take turns, the first of them
    that of number `turn`; who sees nothing left to gain passes.
    """
    front = surrogates.targets.values[surrogates.targets.front]
    promise = surrogates.at(np.concatenate([found, waiting]))
    free = np.arange(len(promise.indices)) < len(found)
    for number in range(len(found), len(found) + len(waiting)):
        front = np.vstack([front, promise.suppose(number)])
    picked: list[int] = []
    gain = np.zeros(len(free))
    for number in range(min(count, len(found), GREEDY)):
        for opinion in (whose_turn(turn + number, surrogates.far), CAUTIOUS, BOLD):
            gain = np.where(free, promise.gain(opinion, front, rng), 0.0)
            if gain.max() > 0:
                break
        best = int(np.argmax(gain))
        if gain[best] <= 0:
            return promise.indices[picked].tolist()
        picked.append(best)
        front = np.vstack([front, promise.suppose(best)])
        free[best] = False
    # Of a huge batch the rest is taken as the last look ranks it.
    gain = np.where(free, gain, 0.0)
    ranked = np.argsort(-gain, kind="stable")[: count - len(picked)]
    return promise.indices[[*picked, *ranked[gain[ranked] > 0].tolist()]].tolist()
