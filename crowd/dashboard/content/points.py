"""Fronts as the crowd measures them, and the newest figure of a device."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

from crowd.devices import revision
from crowd.fronts.content.coverage import Rectangle, coverage, rectangle
from crowd.records.speedup import Speedup
from crowd.results.reading import selectors as results
from crowd.results.reading.aggregates import gain, model_outcomes
from crowd.results.reading.queries.filters import ALL, SpeedupFilters
from crowd.results.reading.rows import DeviceDetail, Gain, Headline, ModelOutcomes
from crowd.results.reading.selectors import Speedups
from crowd.results.reading.transferring.rows import Winners
from crowd.results.reading.versioned_cache import VersionedCache
from wire.front import BEST, DEFAULT, Front, Point, SequenceResult, predicted_speedup


@dataclass(frozen=True)
class MeasuredPoint:
    """A configuration as predicted on the reference device, and as measured by the crowd.

    `predicted_speedup`: over the default on the reference device; None if unknown. `predicted_interval`: its
    95 % interval, once prepared. `crowd`: None for the
    default. `outcomes`: on how many devices it did not finish or lost tracking. `query`: the filters of these
    devices.
    """

    point: Point
    predicted_speedup: float | None
    predicted_interval: tuple[float, float] | None
    crowd: Headline | None
    outcomes: ModelOutcomes
    query: str = ""

    @property
    def n(self) -> int:
        """The number of devices behind the figure of the crowd."""
        return self.crowd.devices if self.crowd else 0


@dataclass(frozen=True)
class MeasuredFront:
    """A front as predicted, and as the crowd under `filters` measures it.

    `points`: fastest first as predicted, those without a time last. `most`: the largest number of devices
    behind a figure. `headline`: the crowd's figure of `best`. `covered`: the share of `rectangle` that the
    front dominates. `gain`: of the fastest configuration on the reference device over `best`, for the crowd.
    """

    front: Front
    filters: SpeedupFilters
    points: tuple[MeasuredPoint, ...]
    headline: Headline
    winners: Winners
    rectangle: Rectangle | None
    covered: float | None
    gain: Gain | None = None

    @property
    def most(self) -> int:
        return max((row.n for row in self.points), default=0)

    @property
    def uneven(self) -> bool:
        """Whether figures are based on different numbers of devices."""
        return any(0 < row.n < self.most for row in self.points)

    @property
    def measured(self) -> bool:
        """Whether any device under the filters has a figure, confirmed or not."""
        return any(row.crowd and row.crowd.devices + row.crowd.unconfirmed for row in self.points)


# An entry with twenty points takes about 10 kB, plus 200 bytes per device.
_measured_cache: VersionedCache[MeasuredFront] = VersionedCache(32)


def measured_front(front: Front, filters: SpeedupFilters) -> MeasuredFront:
    """`front` with the crowd under `filters`. One query if the result is cached."""
    filters = replace(filters, front=front.slug, application=front.application, configuration=BEST)
    return _measured_cache.get(
        revision.current, (front.digest, filters), lambda: _measured_front(front, filters)
    )


def _measured_front(front: Front, filters: SpeedupFilters) -> MeasuredFront:
    crowd = results.speedups(replace(filters, configuration=ALL))
    area = rectangle(front)
    winners = results.winners(filters)
    points = sorted(_points(front, crowd), key=lambda row: row.point.runtime or math.inf)
    return MeasuredFront(
        front=front,
        filters=filters,
        points=tuple(points),
        headline=crowd.headline,
        winners=winners,
        rectangle=area,
        covered=coverage(front, area),
        gain=None if winners.reference == BEST else gain(crowd.rows, winners.reference, BEST),
    )


def _points(front: Front, crowd: Speedups) -> Iterator[MeasuredPoint]:
    """The points of `front` in published order, with the speedups in `crowd`."""
    default = front.point(DEFAULT)
    for point in front.points:
        yield MeasuredPoint(
            point=point,
            predicted_speedup=predicted_speedup(default.predicted, point.predicted) if default else None,
            predicted_interval=point.predicted.interval,
            crowd=None if point.name == DEFAULT else crowd.headline_of(point.name),
            outcomes=model_outcomes(crowd.outcomes, point.name),
            query=replace(crowd.filters, configuration=point.name).query(),
        )


@dataclass(frozen=True)
class SequenceColumn:
    """A sequence that a front was learned on, or (`held_out`) only checked on."""

    name: str
    held_out: bool


@dataclass(frozen=True)
class SequenceRow:
    """A point with its results, or None, in the order of the columns."""

    point: Point
    results: tuple[SequenceResult | None, ...]


def results_by_sequence(front: Front) -> tuple[tuple[SequenceColumn, ...], tuple[SequenceRow, ...]]:
    """The results of the points of `front` on each sequence; empty if unknown."""
    per_point = [_results(point) for point in front.points]
    columns = dict.fromkeys(column for results in per_point for column in results)
    ordered = tuple(sorted(columns, key=lambda column: column.held_out))
    rows = (
        SequenceRow(point, tuple(map(results.get, ordered)))
        for point, results in zip(front.points, per_point, strict=True)
    )
    return ordered, tuple(rows)


def _results(point: Point) -> dict[SequenceColumn, SequenceResult]:
    return {
        SequenceColumn(result.sequence, held_out): result
        for held_out, results in ((False, point.learned_on), (True, point.held_out))
        for result in results
    }


def newest_figure(detail: DeviceDetail) -> Speedup | None:
    """The figure of `best` that the newest session of the device belongs to, otherwise the newest one."""
    figures = [row for row in detail.speedups if row.configuration == BEST]
    newest = detail.latest.session if detail.latest else None
    if newest is not None:
        key = (newest.front, newest.backend, newest.processor)
        for row in figures:
            if (row.front, row.backend, row.processor) == key:
                return row
    return max(figures, key=lambda row: row.last_session_at, default=None)


def parameters_of(front: Front) -> tuple[str, ...]:
    """The names of the parameters of `front`'s configurations, in order of first appearance."""
    return tuple(dict.fromkeys(name for point in front.points for name in point.parameters))
