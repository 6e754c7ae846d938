"""What an exploration found: one value a configuration from all its measurements, and the best of them."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from statistics import median
from typing import Any

import numpy as np

from crowd.explorations.known import DEFAULT
from crowd.explorations.models import Evaluation, Exploration
from pareto.front import nondominated

Phase = Evaluation.Phase
CHOSEN = (Phase.GIVEN, Phase.RANDOM, Phase.ACTIVE)  # why this exploration measured it at all


@dataclass(frozen=True)
class Point:
    """A configuration with the median of each objective over `measurements` measurements.

    Each measurement is a mean over frames already (seconds a frame, metres). Where the point was measured
    again at the end, in turn with the others, only those `repeats` count: what chose it may have been luck.
    `low` and `high` are the least and the greatest of what the median was taken of; `whole` says that these
    measurements ran over the whole sequence. `phase` tells why it was measured, `known` where it never was
    here.
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


def measured(evaluations: Iterable[Evaluation]) -> list[Point]:
    """Every configuration that was measured, in the order of its first measurement.

    What another device measured is prior knowledge and no measurement.
    """
    groups: dict[str, list[Evaluation]] = {}
    for evaluation in evaluations:
        if evaluation.state == Evaluation.State.DONE and evaluation.phase != Phase.PRIOR:
            groups.setdefault(evaluation.configuration_key, []).append(evaluation)
    return [_point(group) for group in groups.values()]


def searched(exploration: Exploration, evaluations: Iterable[Evaluation]) -> list[Point]:
    """As `measured`, but of the measurements alone that run as many frames as the search does."""
    return measured(evaluation for evaluation in evaluations if evaluation.frames == exploration.frames)


def comparable(points: Iterable[Point]) -> list[Point]:
    """Those measured over the whole sequence where there are any, else all of them.

    Over fewer frames less error gathers, so that the two kinds may not be compared.
    """
    points = list(points)
    return [point for point in points if point.whole] or points


def front(exploration: Exploration, points: Iterable[Point]) -> list[Point]:
    """The comparable points within the exploration's limits that no other of them beats, fastest first."""
    names = exploration.objectives
    within = [
        point
        for point in comparable(points)
        if all(name in point.values for name in names)
        and all(point.values[name] <= limit for name, limit in exploration.limits.items())
    ]
    table = np.array([[point.values[name] for name in names] for point in within]).reshape(-1, len(names))
    kept = [point for point, keep in zip(within, nondominated(table), strict=True) if keep]
    return sorted(kept, key=lambda point: point.values["runtime"])


def worth_publishing(exploration: Exploration, evaluations: Iterable[Evaluation]) -> list[Point]:
    """The known configurations that work, and up to `exploration.points` points spread along the front.

    The fastest and the most accurate are always among the latter. It is the front of what the search runs:
    what was measured over more frames afterwards says nothing of the other points.
    """
    points = searched(exploration, evaluations)
    given = [point for point in points if point.label]
    found = [point for point in front(exploration, points) if not point.label]
    return given + spread(found, exploration.points)


def spread(points: Sequence[Point], count: int) -> list[Point]:
    """COUNT of the POINTS (fastest first), both ends and the most evenly spaced in log runtime between."""
    if len(points) <= count:
        return list(points)
    place = np.log([point.values["runtime"] for point in points])
    chosen = [0, len(points) - 1]
    while len(chosen) < count:
        distance = np.abs(place[:, None] - place[chosen]).min(axis=1)
        distance[chosen] = -1.0
        chosen.append(int(np.argmax(distance)))
    return [points[number] for number in sorted(chosen)]


def default(points: Iterable[Point]) -> Point | None:
    """The default configuration's point, None where it was not measured."""
    return next((point for point in points if point.label == DEFAULT), None)


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
    )
