"""What a page tells of an exploration beyond its rows: how much is valid, and what the search gained."""

from dataclasses import dataclass

import numpy as np

from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.outcomes.readings import Found
from crowd.explorations.outcomes.watching import Watch, found
from crowd.explorations.searching.points import Point, comparable, default, settled, speed_objective, speedup
from pareto.fronts.hypervolume import hypervolume_growth
from slam.protocol import VALID_BELOW


@dataclass(frozen=True)
class Yield:
    """How many configurations were measured and are valid, and the fastest valid one (None: none is).

    `known` more were measured by an earlier exploration; valid and fastest may be among these. Once the
    search is done, the fastest is one that was measured again. `speedup` is how many
    times faster it is than the default, on the reference device.
    """

    measured: int
    known: int
    valid: int
    fastest: Point | None
    speedup: float | None


def ate_limit(exploration: Exploration) -> float:
    """The largest maximum trajectory error (m) that the exploration accepts."""
    return float(exploration.limits.get("ate_max", VALID_BELOW))


def yield_of(exploration: Exploration, have: Found) -> Yield:
    """What the measurements of EXPLORATION come to."""
    limit = ate_limit(exploration)
    alike = comparable(have.points)
    valid = [
        point
        for point in alike
        if "runtime" in point.values and point.values.get("ate_max", limit) < limit and not point.censored
    ]
    best = settled(exploration, valid)
    name = speed_objective(best)
    fastest = min(best, key=lambda point: point.values[name], default=None)
    known = sum(point.phase == Evaluation.Phase.KNOWN for point in have.points)
    return Yield(
        measured=len(have.points) - known,
        known=known,
        valid=len(valid),
        fastest=fastest,
        speedup=speedup(default(alike), fastest),
    )


def measured_again(exploration: Exploration, have: Found) -> int:
    """On how many configurations the front rests because they were measured again; 0 while it rests on all
    that were measured.
    """
    rested = settled(exploration, have.points)
    done = exploration.state == Exploration.State.DONE
    return len(rested) if done and rested and all(point.repeats for point in rested) else 0


def growth_of(seen: Watch) -> list[float]:
    """The share (0 to 1) of a rectangle that is covered after each configuration that the search measured,
    failures included, in that order.

    The rectangle goes from the ideal point, the least value of each objective found so far within the limits,
    to the limits; where an objective has none, to its worst value measured so far.
    """
    names = seen.exploration.objectives
    values = [[(row or {}).get(name) for name in names] for row in found(seen).values]
    table = np.array(values, dtype=np.float64).reshape(-1, len(names))
    limits = [seen.exploration.limits.get(name) for name in names]
    growth = hypervolume_growth(table, limits)
    grew = np.diff(growth, prepend=0.0) > 0
    if not grew.any():
        return growth.tolist()
    whole = hypervolume_growth(np.vstack([table, table[grew].min(axis=0)]), limits)[-1]
    return np.minimum(growth / whole, 1.0).tolist()
