"""The outcome and the progress of an exploration, as its page shows them."""

from dataclasses import dataclass

import numpy as np

from crowd.explorations.models import Evaluation, Exploration
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
from pareto.fronts.hypervolume import hypervolume_growth
from slam.protocol import VALID_BELOW


@dataclass(frozen=True)
class SearchOutcome:
    """The numbers of measured and valid configurations, and the fastest valid one, or None.

    `known` further ones were measured by an earlier exploration; they may be valid and fastest. When the
    search is done, `fastest` is one that was measured again. `speedup`: over the default on the reference
    device.
    """

    measured: int
    known: int
    valid: int
    fastest: Point | None
    speedup: float | None


def ate_limit(exploration: Exploration) -> float:
    """The limit (m) of the largest trajectory error in `exploration`."""
    return float(exploration.limits.get("ate_max", VALID_BELOW))


def outcome_of(exploration: Exploration, have: SearchResults) -> SearchOutcome:
    """The outcome of `exploration`."""
    limit = ate_limit(exploration)
    alike = comparable(have.points)
    valid = [
        point
        for point in alike
        if "runtime" in point.values and point.values.get("ate_max", limit) < limit and not point.censored
    ]
    best = reliable(exploration, valid)
    name = speed_objective(best)
    fastest = min(best, key=lambda point: point.values[name], default=None)
    known = sum(point.phase == Evaluation.Phase.KNOWN for point in have.points)
    return SearchOutcome(
        measured=len(have.points) - known,
        known=known,
        valid=len(valid),
        fastest=fastest,
        speedup=speedup(default_point(alike), fastest),
    )


def measured_again(exploration: Exploration, have: SearchResults) -> int:
    """The number of repeated configurations that the front is based on; 0 while it is based on all."""
    rested = reliable(exploration, have.points)
    done = exploration.state == Exploration.State.DONE
    return len(rested) if done and rested and all(point.repeats for point in rested) else 0


def growth_of(seen: ExplorationStatus) -> list[float]:
    """The covered share (0 to 1) of a rectangle after each searched configuration, including failures.

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
