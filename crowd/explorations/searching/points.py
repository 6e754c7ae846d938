"""What an exploration found: one value a configuration from all its measurements, and the best of them."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from statistics import median
from typing import Any, NamedTuple

import numpy as np

from crowd.explorations.models import Evaluation, Exploration
from crowd.explorations.objectives import RATIO
from crowd.explorations.searching.baseline_configurations import DEFAULT
from pareto.fronts.front import nondominated

Phase = Evaluation.Phase
CHOSEN = (Phase.GIVEN, Phase.RANDOM, Phase.ACTIVE)  # why this exploration measured it at all


class Row(NamedTuple):
    """What is read of an evaluation to tell what was found."""

    pk: int
    number: int
    phase: str
    label: str
    configuration: dict[str, Any]
    configuration_key: str
    place: int | None  # in the space
    frames: int | None
    state: str
    objectives: dict[str, float] | None
    censored: bool
    created_at: datetime
    finished_at: datetime | None


@dataclass(frozen=True)
class Point:
    """A configuration with the median of each objective over `measurements` measurements.

    Each measurement is a mean over frames already (seconds a frame, metres). Where the point was measured
    again at the end, in turn with the others, only those `repeats` count: what chose it may have been luck.
    `low` and `high` are the least and the greatest of what the median was taken of; `whole` says that these
    measurements ran over the whole sequence. `censored` says that a measurement ended before all sequences
    were run: errors are at least so large. `phase` says why it was measured, `known` where it never was
    here. `number` is that of its first measurement.
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
    censored: bool = False
    number: int | None = None


def speed_objective(points: Iterable[Point]) -> str:
    """By what POINTS are compared for speed: by the ratio to the default's runtime where all have it."""
    points = list(points)
    return RATIO if points and all(RATIO in point.values for point in points) else "runtime"


def speedup(default: Point | None, point: Point | None) -> float | None:
    """How many times faster POINT is than DEFAULT; None where either is unknown."""
    if default is None or point is None:
        return None
    name = speed_objective([default, point])
    before, after = default.values.get(name), point.values.get(name)
    return before / after if before and after else None


def measured(evaluations: Iterable[Evaluation | Row]) -> list[Point]:
    """Every configuration that was measured, in the order of its first measurement.

    What another device measured is prior knowledge and no measurement.
    """
    groups: dict[str, list[Evaluation | Row]] = {}
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


def settled(exploration: Exploration, points: Iterable[Point]) -> list[Point]:
    """What figures may rest on: all, until the search is done; then what was measured again, if anything was.

    Of hundreds of single measurements the luckiest would beat the medians.
    """
    points = list(points)
    again = [point for point in points if point.repeats]
    done = exploration.state == Exploration.State.DONE and any(not point.label for point in again)
    return again if done else points


def front(exploration: Exploration, points: Iterable[Point]) -> list[Point]:
    """The comparable points within the exploration's limits that no other of them beats, fastest first.

    A point whose errors are only known to be at least so large is never one of them.
    """
    alike = comparable(points)
    table = np.column_stack([_column(alike, name) for name in exploration.objectives])
    within = ~np.isnan(table).any(axis=1) & np.array([not point.censored for point in alike], dtype=bool)
    for name, limit in exploration.limits.items():
        within &= _column(alike, name) <= limit
    rows = np.flatnonzero(within)
    kept = [alike[row] for row in rows[nondominated(table[rows])]]
    name = speed_objective(kept)
    return sorted(kept, key=lambda point: point.values[name])


def worth_publishing(
    exploration: Exploration,
    evaluations: Iterable[Evaluation],
    recommended: Sequence[Mapping[str, Any]] | None = None,
) -> list[Point]:
    """The known configurations that work, and up to `exploration.points` points spread along the front.

    The fastest and the most accurate are always among the latter. It is the front of what the search runs:
    what was measured over more frames afterwards says nothing of the other points. Where measurements of one
    configuration differ it is the front of the `recommended` configurations.
    """
    points = searched(exploration, evaluations)
    given = [point for point in points if point.label]
    best = front(exploration, points)
    if recommended is not None:
        name = speed_objective(points)
        best = [point for point in points if point.configuration in recommended]
        best.sort(key=lambda point: point.values[name])
    found = [point for point in best if not point.label]
    return given + spread(found, exploration.points)


def spread(points: Sequence[Point], count: int) -> list[Point]:
    """COUNT of the POINTS (fastest first): both ends, and between them evenly in the log of runtime."""
    if len(points) <= count:
        return list(points)
    name = speed_objective(points)
    place = np.log([point.values[name] for point in points])
    chosen = [0, len(points) - 1]
    while len(chosen) < count:
        distance = np.abs(place[:, None] - place[chosen]).min(axis=1)
        distance[chosen] = -1.0
        chosen.append(int(np.argmax(distance)))
    return [points[number] for number in sorted(chosen)]


def default(points: Iterable[Point]) -> Point | None:
    """The default configuration's point, None where it was not measured."""
    return next((point for point in points if point.label == DEFAULT), None)


def _column(points: Sequence[Point], name: str) -> np.ndarray:
    """One objective of all POINTS, NaN where it is unknown: ten thousand at once, as a page waits for it."""
    return np.array([point.values.get(name) for point in points], dtype=np.float64)


def _point(group: Sequence[Evaluation | Row]) -> Point:
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
        censored=any(evaluation.censored for evaluation in again or group),
        number=min(evaluation.number for evaluation in group),
    )
