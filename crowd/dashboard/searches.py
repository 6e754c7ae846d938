"""What a page tells of an exploration beyond its rows: how much is valid, and what the search gained."""

from dataclasses import dataclass

from crowd.explorations.models import Exploration
from crowd.explorations.points import Point, default, measured
from crowd.explorations.selectors import Detail
from crowd.results.statistics import MAX_ATE


@dataclass(frozen=True)
class Yield:
    """How many configurations were measured and are valid, and the fastest valid one (None: none is).

    speedup is the default's runtime over the fastest valid one's, both on the reference device.
    """

    measured: int
    valid: int
    fastest: Point | None
    speedup: float | None


def ate_limit(exploration: Exploration) -> float:
    """The largest maximum trajectory error (m) that the exploration accepts."""
    return float(exploration.limits.get("ate_max", MAX_ATE))


def yield_of(detail: Detail) -> Yield:
    """What DETAIL's evaluations come to."""
    points = measured(detail.evaluations)
    limit = ate_limit(detail.progress.exploration)
    valid = [
        point for point in points if "runtime" in point.values and point.values.get("ate_max", limit) < limit
    ]
    fastest = min(valid, key=lambda point: point.values["runtime"], default=None)
    baseline = default(points)
    return Yield(
        measured=len(points),
        valid=len(valid),
        fastest=fastest,
        speedup=baseline.values["runtime"] / fastest.values["runtime"]
        if fastest and baseline and fastest.values["runtime"]
        else None,
    )
