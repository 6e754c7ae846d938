"""The outcome and the progress of an exploration, as its page shows them."""

from dataclasses import dataclass

import numpy as np

from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.objectives import LOST_MORE
from crowd.explorations.outcomes.results_cache import SearchResults
from crowd.explorations.outcomes.watching import ExplorationStatus, results_of
from crowd.explorations.searching.points import (
    Point,
    comparable,
    default_point,
    reliable,
    speed_objective,
    speedup,
)
from crowd.results.reading.versioned_cache import VersionedCache
from pareto.fronts.front import nondominated
from pareto.fronts.hypervolume import hypervolume_growth
from wire.protocol import VALID_BELOW


@dataclass(frozen=True)
class Yield:
    """What a phase of the search found: how many configurations it `tried`, and how many were `valid`.

    `front`: error (m) and time (s) of the valid ones that no other one of the phase beats and that do not
    lose the camera more often than the default, most accurate first; each was measured once. `fastest`: the
    time (s) of the fastest of them.
    """

    tried: int
    valid: int
    front: tuple[tuple[float, float], ...]

    @property
    def fastest(self) -> float | None:
        return min((runtime for _, runtime in self.front), default=None)


@dataclass(frozen=True)
class SearchOutcome:
    """The numbers of measured and valid configurations, and the fastest valid one, or None.

    `known` further ones were measured by an earlier exploration; they may be the fastest. When the search is
    done, `fastest` is one that was measured again. `speedup`: over the default on the reference device.
    `covered`: the last of `growth_of`, None before anything was searched.
    """

    measured: int
    known: int
    valid: int
    fastest: Point | None
    speedup: float | None
    random: Yield
    active: Yield
    covered: float | None

    @property
    def gain(self) -> float | None:
        """How much faster the fastest valid configuration of active learning is than that of chance."""
        if self.random.fastest is None or self.active.fastest is None:
            return None
        return self.random.fastest / self.active.fastest


# An outcome is small, but at ten thousand measurements it takes as long as the rest of the page.
_outcomes: VersionedCache[SearchOutcome] = VersionedCache(32)


def ate_limit(exploration: Exploration) -> float:
    """The limit (m) of the largest trajectory error in `exploration`."""
    return float(exploration.limits.get("ate_max", VALID_BELOW))


def outcome_of(seen: ExplorationStatus) -> SearchOutcome:
    """The outcome of the exploration `seen` so far."""
    exploration = seen.exploration
    return _outcomes.get(lambda: seen.results, exploration.pk, lambda: _outcome_of(seen))


def _outcome_of(seen: ExplorationStatus) -> SearchOutcome:
    exploration, have = seen.exploration, results_of(seen)
    limit = ate_limit(exploration)
    alike = comparable(have.points)

    def is_valid(point: Point) -> bool:
        known = "runtime" in point.values and not point.censored
        return known and point.values.get("ate_max", limit) < limit

    best = reliable(exploration, filter(is_valid, alike))
    name = speed_objective(best)
    fastest = min(best, key=lambda point: point.values[name], default=None)
    known = sum(point.phase == Evaluation.Phase.KNOWN for point in have.points)
    return SearchOutcome(
        measured=len(have.points) - known,
        known=known,
        valid=sum(is_valid(point) for point in have.points if point.phase != Evaluation.Phase.KNOWN),
        fastest=fastest,
        speedup=speedup(default_point(alike), fastest),
        random=yield_of(exploration, have, Evaluation.Phase.RANDOM),
        active=yield_of(exploration, have, Evaluation.Phase.ACTIVE),
        covered=next(reversed(growth_of(seen)), None),
    )


def yield_of(exploration: Exploration, have: SearchResults, phase: str) -> Yield:
    """What the measurements of `phase` found."""
    limit = ate_limit(exploration)
    of_phase = [row for row, of in zip(have.values, have.phases, strict=True) if of == phase]
    valid = [row for row in of_phase if row and "runtime" in row and row.get("ate_max", limit) < limit]
    steady = [(row["ate_max"], row["runtime"]) for row in valid if not row.get(LOST_MORE)]
    table = np.array(steady, dtype=np.float64).reshape(-1, 2)
    front = sorted(steady[row] for row in np.flatnonzero(nondominated(table)))
    return Yield(len(of_phase), len(valid), tuple(front))


def measured_again(exploration: Exploration, have: SearchResults) -> int:
    """The number of repeated configurations that the front is based on; 0 while it is based on all."""
    rested = reliable(exploration, have.points)
    done = exploration.state == Exploration.State.DONE
    return len(rested) if done and rested and all(point.repeats for point in rested) else 0


def growth_of(seen: ExplorationStatus) -> list[float]:
    """The share (0 to 1) of a rectangle's hypervolume that each searched configuration leaves covered.

    Failures are included.

    The rectangle spans from the ideal point, the best value of each objective within the limits, to the
    limits. An objective without a limit ends at the worst of its first ten values.
    """
    names = seen.exploration.objectives
    values = [[(row or {}).get(name) for name in names] for row in results_of(seen).values]
    table = np.array(values, dtype=np.float64).reshape(-1, len(names))
    limits = [seen.exploration.limits.get(name) for name in names]
    growth = hypervolume_growth(table, limits)
    grew = np.diff(growth, prepend=0.0) > 0
    if grew.any():
        whole = hypervolume_growth(np.vstack([table, table[grew].min(axis=0)]), limits)[-1]
        growth = np.minimum(growth / whole, 1.0)
    shares: list[float] = growth.tolist()
    return shares
