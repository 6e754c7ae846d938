"""A front's configurations, each with what the crowd measured of it."""

from collections.abc import Sequence
from dataclasses import dataclass

from crowd.fronts.selectors import DEFAULT, Front, Point
from crowd.results.rows import Headline, Speedup
from crowd.results.selectors import headline


@dataclass(frozen=True)
class MeasuredPoint:
    """A configuration: predicted on the reference device, measured by the crowd (None for the default).

    predicted_speedup is the default's runtime over this one's, both predicted; None where either is unknown.
    """

    point: Point
    predicted_speedup: float | None
    crowd: Headline | None


def measured_points(front: Front, rows: Sequence[Speedup]) -> tuple[MeasuredPoint, ...]:
    """FRONT's points in published order; ROWS are the crowd's speedups of all its configurations."""
    default = front.point(DEFAULT)
    baseline = default.runtime if default else None
    return tuple(
        MeasuredPoint(
            point=point,
            predicted_speedup=baseline / point.runtime if baseline and point.runtime else None,
            crowd=None if point.name == DEFAULT else headline(rows, point.name),
        )
        for point in front.points
    )


def parameters_of(front: Front) -> tuple[str, ...]:
    """Names of the parameters that FRONT's configurations set, in the order of the first that names them."""
    return tuple(dict.fromkeys(name for point in front.points for name in point.parameters))
