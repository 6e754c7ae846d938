"""The points of an exploration: one per configuration, from all its measurements, and the best of them."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from statistics import median
from typing import Any

import numpy as np

from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.objectives import LOST_MORE, RATIO
from crowd.explorations.searching.applications import application_of
from crowd.explorations.searching.baseline_configurations import DEFAULT
from crowd.explorations.searching.batches import configuration_digest
from pareto.fronts.front import nondominated
from slam.definitions import SYSTEMS

Phase = Evaluation.Phase
CHOSEN = (Phase.GIVEN, Phase.RANDOM, Phase.ACTIVE)  # the phases that chose a configuration


@dataclass(frozen=True)
class Point:
    """A configuration with the median of each objective over `measurements` (seconds per frame, metres).

    If it was repeated at the end, only these `repeats` count: it may have been chosen by luck. `low`, `high`:
    the range of the measurements. `whole`: they ran over the whole sequence. `censored`: the objectives that
    are at least this large, since a measurement ended early. `phase`: why it was measured; `known` if it was
    not measured here. `number`: that of its first measurement.
    """

    configuration: dict[str, Any]
    label: str
    phase: str
    values: dict[str, float]
    measurements: int
    repeats: int
    low: dict[str, float] = field(default_factory=dict)
    high: dict[str, float] = field(default_factory=dict)
    whole: bool = True
    censored: tuple[str, ...] = ()
    number: int | None = None

    @cached_property
    def key(self) -> str:
        """The digest of its configuration."""
        return configuration_digest(self.configuration)

    @property
    def least(self) -> str:
        """The words before its error: whether it is only a bound."""
        return "at least " if "ate_max" in self.censored else ""

    @property
    def loses(self) -> bool:
        """Whether it lost the camera in more frames than the default in a measurement."""
        return self.high.get(LOST_MORE, 0) > 0


def speed_objective(points: Iterable[Point]) -> str:
    """The objective that compares the speed of `points`: the runtime ratio if all have it, else runtime."""
    points = list(points)
    return RATIO if points and all(RATIO in point.values for point in points) else "runtime"


def speedup(default: Point | None, point: Point | None) -> float | None:
    """The speedup of `point` over `default`; None if either is unknown."""
    if default is None or point is None:
        return None
    name = speed_objective([default, point])
    before, after = default.values.get(name), point.values.get(name)
    return before / after if before and after else None


def measured_points(evaluations: Iterable[Evaluation]) -> list[Point]:
    """All measured configurations, in the order of their first measurements, without priors."""
    groups: dict[str, list[Evaluation]] = {}
    for evaluation in evaluations:
        if evaluation.state == Evaluation.State.DONE and evaluation.phase != Phase.PRIOR:
            groups.setdefault(evaluation.configuration_key, []).append(evaluation)
    return [_point(group) for group in groups.values()]


def searched_points(exploration: Exploration, evaluations: Iterable[Evaluation]) -> list[Point]:
    """As `measured_points`, but only from measurements with as many frames as the search."""
    return measured_points(
        evaluation for evaluation in evaluations if evaluation.frames == exploration.frames
    )


def comparable(points: Iterable[Point]) -> list[Point]:
    """The points over the whole sequence, if there are any, else all.

    Errors over fewer frames are smaller, so the two kinds are not comparable.
    """
    points = list(points)
    return [point for point in points if point.whole] or points


def reliable(exploration: Exploration, points: Iterable[Point]) -> list[Point]:
    """All points until the search is done; then the repeated ones, if there are any.

    The luckiest of hundreds of single measurements would beat the medians.
    """
    points = list(points)
    again = [point for point in points if point.repeats]
    done = exploration.state == Exploration.State.DONE and any(not point.label for point in again)
    return again if done else points


def best_points(exploration: Exploration, points: Iterable[Point]) -> list[Point]:
    """The non-dominated comparable points within the exploration's limits, fastest first.

    Censored points and those that lose the camera more often than the default are never among them.
    """
    same_kind = comparable(points)
    table = np.column_stack([_column(same_kind, name) for name in exploration.objectives])
    usable = np.array([not point.censored and not point.loses for point in same_kind], dtype=bool)
    within = ~np.isnan(table).any(axis=1) & usable
    for name, limit in exploration.limits.items():
        within &= _column(same_kind, name) <= limit
    rows = np.flatnonzero(within)
    kept = [same_kind[row] for row in rows[nondominated(table[rows])]]
    name = speed_objective(kept)
    return sorted(kept, key=lambda point: point.values[name])


def worth_publishing(
    exploration: Exploration,
    evaluations: Iterable[Evaluation],
    recommended: Sequence[Mapping[str, Any]] | None = None,
) -> list[Point]:
    """The known configurations that work, and up to `exploration.points` points spread along the front.

    The fastest and the most accurate are always included. The front is that of the search's own measurements,
    since those over more frames are not comparable. With `recommended`, the front is these configurations.
    Where some configurations leave out frames, as many points follow that compute every frame: `best` is one.
    Of several systems, as many follow of each: one's front may be all behind another's.
    """
    points = searched_points(exploration, evaluations)
    given = [point for point in points if point.label]
    best = best_points(exploration, points)
    if recommended is not None:
        name = speed_objective(points)
        best = [point for point in points if point.configuration in recommended]
        best.sort(key=lambda point: point.values[name])
    chosen = given + spread([point for point in best if not point.label], exploration.points)
    systems = [application_of(exploration, point.configuration) for point in points]
    pairs = list(zip(systems, points, strict=True))
    kinds = [[point for system, point in pairs if not skips(system, point)]]
    kinds += [[point for system, point in pairs if system == one] for one in sorted(set(systems))]
    for kind in kinds:
        if len(kind) < len(points):
            fixed = [point for point in best_points(exploration, kind) if point not in given]
            chosen += [point for point in spread(fixed, exploration.points) if point not in chosen]
    return chosen


def skips(application: str, point: Point) -> bool:
    """Whether `point` leaves out frames by the camera's motion."""
    return application in SYSTEMS and SYSTEMS[application].skips(point.configuration)


def spread(points: Sequence[Point], count: int) -> list[Point]:
    """`count` of `points` (fastest first): both ends, and between them evenly in log runtime."""
    if len(points) <= count:
        return list(points)
    name = speed_objective(points)
    logs = np.log([point.values[name] for point in points])
    chosen = [0, len(points) - 1]
    while len(chosen) < count:
        distance = np.abs(logs[:, None] - logs[chosen]).min(axis=1)
        distance[chosen] = -1.0
        chosen.append(int(np.argmax(distance)))
    return [points[number] for number in sorted(chosen)]


def default_point(points: Iterable[Point]) -> Point | None:
    """The point of the default configuration; None if it was not measured."""
    return next((point for point in points if point.label == DEFAULT), None)


def _column(points: Sequence[Point], name: str) -> np.ndarray:
    """One objective of all `points`, NaN if unknown, as an array for speed."""
    return np.array([point.values.get(name) for point in points], dtype=np.float64)


def _point(group: Sequence[Evaluation]) -> Point:
    again = [evaluation for evaluation in group if evaluation.phase == Phase.REPEAT]
    rows = [evaluation.objectives or {} for evaluation in again or group]
    names = [name for name in rows[0] if all(name in row for row in rows)]
    columns = {name: [float(row[name]) for row in rows] for name in names}
    return Point(
        configuration=group[0].configuration,
        label=next((evaluation.label for evaluation in group if evaluation.label), ""),
        phase=next((row.phase for row in group if row.phase in CHOSEN), group[0].phase),
        values={name: median(column) for name, column in columns.items()},
        measurements=len(rows),
        repeats=len(again),
        low={name: min(column) for name, column in columns.items()},
        high={name: max(column) for name, column in columns.items()},
        whole=all(evaluation.frames is None for evaluation in again or group),
        censored=tuple(sorted({name for evaluation in again or group for name in evaluation.censored})),
        number=min(evaluation.number for evaluation in group),
    )
