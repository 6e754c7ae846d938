"""How much of what is possible a front covers: its hypervolume as a share of one rectangle.

The rectangle's far corner is the limit of the error and the default's time: beyond it a configuration is
invalid, or no faster than the default. Its near corner is the ideal point, the least error and the least time
of any configuration within. Both axes are logarithmic, as a front is drawn. One configuration at the ideal
point would cover all of it.
"""

from collections.abc import Iterable
from typing import NamedTuple

from crowd.fronts.content.protocol import max_ate
from crowd.fronts.selectors import DEFAULT, Front, Point
from pareto.fronts.hypervolume import hypervolume

# Metres: less than any measurement resolves, and more than 0, which has no logarithm.
LEAST_ATE = 1e-4

Place = tuple[float, float]  # m, seconds a frame


class Rectangle(NamedTuple):
    """From the IDEAL point to the CORNER."""

    ideal: Place
    corner: Place


def rectangle(*fronts: Front) -> Rectangle | None:
    """One rectangle for all FRONTS: the largest of their limits and the slowest of their defaults.

    None where no default was measured, or no configuration is faster than it and valid.
    """
    defaults = [front.point(DEFAULT) for front in fronts]
    runtimes = [point.runtime for point in defaults if point is not None and point.runtime]
    if not runtimes:
        return None
    corner = max(max_ate(front.protocol) for front in fronts), max(runtimes)
    within = [
        (error, runtime)
        for front in fronts
        for error, runtime in places(front.points)
        if error < corner[0] and runtime < corner[1]
    ]
    if not within:
        return None
    errors, times = zip(*within, strict=True)
    return Rectangle((min(errors), min(times)), corner)


def coverage(front: Front, within: Rectangle | None) -> float | None:
    """The share (0 to 1) of the rectangle WITHIN that FRONT dominates; None where there is no rectangle."""
    if within is None:
        return None
    whole = hypervolume([within.ideal], within.corner, log=True)
    return hypervolume(list(places(front.points)), within.corner, log=True) / whole


def places(points: Iterable[Point]) -> Iterable[Place]:
    """Error and time of those of POINTS that have both."""
    for point in points:
        if point.ate_max is not None and point.runtime:
            yield max(point.ate_max, LEAST_ATE), point.runtime
