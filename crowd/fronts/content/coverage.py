"""The coverage of a front: its hypervolume as a share of a rectangle, with logarithmic axes.

The corner of the rectangle, the reference point, is the limit of the error and the runtime of the default:
beyond it a configuration is invalid, or not faster than the default. The opposite corner is the ideal point:
the least error and the least runtime of all configurations inside.
"""

from collections.abc import Iterable
from typing import NamedTuple

from pareto.fronts.hypervolume import hypervolume
from wire.front import DEFAULT, Front, Point

# In metres: below the resolution of any measurement; 0 has no logarithm.
LEAST_ATE = 1e-4

Objectives = tuple[float, float]  # error (m), seconds per frame


class Rectangle(NamedTuple):
    """The rectangle between the ideal point and the reference point `corner`."""

    ideal: Objectives
    corner: Objectives


def rectangle(*fronts: Front) -> Rectangle | None:
    """A common rectangle for `fronts`, from the largest limit and the slowest default.

    None if no default was measured, or no configuration is valid and faster than it.
    """
    defaults = [front.point(DEFAULT) for front in fronts]
    runtimes = [point.runtime for point in defaults if point is not None and point.runtime]
    if not runtimes:
        return None
    corner = max(front.protocol.max_ate for front in fronts), max(runtimes)
    within = [
        (error, runtime)
        for front in fronts
        for error, runtime in objective_pairs(front.points)
        if error < corner[0] and runtime < corner[1]
    ]
    if not within:
        return None
    errors, times = zip(*within, strict=True)
    return Rectangle((min(errors), min(times)), corner)


def coverage(front: Front, within: Rectangle | None) -> float | None:
    """The share (0 to 1) of the rectangle `within` that `front` dominates; None without a rectangle."""
    if within is None:
        return None
    whole = hypervolume([within.ideal], within.corner, log=True)
    return hypervolume(list(objective_pairs(front.points)), within.corner, log=True) / whole


def objective_pairs(points: Iterable[Point]) -> Iterable[Objectives]:
    """The error and runtime of those `points` that have both."""
    for point in points:
        if point.ate_max is not None and point.runtime:
            yield max(point.ate_max, LEAST_ATE), point.runtime
