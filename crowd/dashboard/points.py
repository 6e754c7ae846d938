"""Which figures a page leads with: a front's configurations as measured, a device's newest speedup."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from crowd.fronts.selectors import BEST, DEFAULT, Front, Point, predicted_speedup
from crowd.results.reading.rows import Attempts, DeviceDetail, Headline, Speedup
from crowd.results.reading.selectors import Speedups, attempts, headline


@dataclass(frozen=True)
class MeasuredPoint:
    """A configuration: predicted on the reference device, measured by the crowd (None for the default).

    predicted_speedup is over the default, on the reference device; None where either is unknown.
    `attempts`: on how many devices it did not finish, or lost the camera.
    """

    point: Point
    predicted_speedup: float | None
    crowd: Headline | None
    attempts: Attempts


def measured_points(front: Front, crowd: Speedups) -> tuple[MeasuredPoint, ...]:
    """FRONT's points in published order; CROWD holds the speedups of all its configurations."""
    default = front.point(DEFAULT)
    return tuple(
        MeasuredPoint(
            point=point,
            predicted_speedup=predicted_speedup(default.predicted, point.predicted) if default else None,
            crowd=None if point.name == DEFAULT else headline(crowd.rows, point.name),
            attempts=attempts(crowd.attempts, point.name),
        )
        for point in front.points
    )


@dataclass(frozen=True)
class SequenceColumn:
    """A sequence that a front was learned on or, `held_out`, only checked on."""

    name: str
    held_out: bool


@dataclass(frozen=True)
class SequenceRow:
    """A point with its result on each sequence, {ate_max, lost} or None, in the order of the columns."""

    point: Point
    results: tuple[Mapping[str, Any] | None, ...]


def results_by_sequence(front: Front) -> tuple[tuple[SequenceColumn, ...], tuple[SequenceRow, ...]]:
    """What FRONT's points reached on each sequence; nothing where that is not known."""
    found = [_results(point) for point in front.points]
    columns = dict.fromkeys(column for results in found for column in results)
    ordered = tuple(sorted(columns, key=lambda column: column.held_out))
    rows = (
        SequenceRow(point, tuple(map(results.get, ordered)))
        for point, results in zip(front.points, found, strict=True)
    )
    return ordered, tuple(rows)


def _results(point: Point) -> dict[SequenceColumn, Mapping[str, Any]]:
    return {
        SequenceColumn(result["sequence"], held_out): result
        for held_out, results in ((False, point.learned_on), (True, point.held_out))
        for result in results
    }


def newest_figure(detail: DeviceDetail) -> Speedup | None:
    """The device's figure of `best` that its newest session belongs to, else the newest there is."""
    figures = [row for row in detail.speedups if row.configuration == BEST]
    newest = detail.latest.session if detail.latest else None
    if newest is not None:
        key = (newest.front, newest.backend, newest.processor)
        for row in figures:
            if (row.front, row.backend, row.processor) == key:
                return row
    return max(figures, key=lambda row: row.last_session_at, default=None)


def parameters_of(front: Front) -> tuple[str, ...]:
    """Names of the parameters that FRONT's configurations set, in the order of the first that names them."""
    return tuple(dict.fromkeys(name for point in front.points for name in point.parameters))
