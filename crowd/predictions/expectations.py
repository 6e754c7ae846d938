"""Predicts the speedup of each configuration on a device, from its own figures and those of relatives."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from crowd.fronts.content.generalisation import Results, generalises
from crowd.predictions import tables
from crowd.predictions.measurements import Figure
from crowd.predictions.tables import CrowdTable
from pareto.devices.ladder import interval
from pareto.devices.prediction import Belief, Observation
from wire.front import DEFAULT, Front, Point

MAX_RELATIVES = 8  # of a family, those with the most measurements
MAX_NEAREST = 3
NOTHING = Observation(np.array([], dtype=np.intp), np.array([]), np.array([]))


@dataclass(frozen=True)
class PredictedPoint:
    """A configuration on one device: its speedup over the default, with a 95 % interval.

    `measured`: the device measured it, and the interval is that of its figure. `ate_max` (m): the
    largest error on the sequences that the front was learned on, or that the device measured; None without a
    known error. `skipped`: the share of the frames that it left out on the reference device; None if it
    computes all. `held_out_ate_max` (m): the largest error on held-out sequences; None without one.
    `generalises`: it is not much worse than the default there.
    """

    configuration: str
    parameters: dict[str, Any]
    ate_max: float | None
    ratio: float
    low: float
    high: float
    measured: bool
    probe: bool
    skipped: float | None = None
    held_out_ate_max: float | None = None
    generalises: bool = True


@dataclass(frozen=True)
class LearnedMap:
    """What was learned from the devices of a group. `belief` is about a new device.

    Intervals are `scale` times as wide as the belief says. `devices` and `sessions` are 0 if only the
    reference device is known.
    """

    rung: str
    belief: Belief
    scale: float
    devices: int = 0
    sessions: int = 0


@dataclass(frozen=True)
class SimilarRow:
    """A row of the table that is similar to a device, and why."""

    row: str
    why: str


@dataclass(frozen=True)
class FrontPrediction:
    """All configurations of a front on one device, default first, and the `nearest` rows, nearest first.

    `seconds`: time per frame of the default, None if unknown. `rung`: the model. `devices` and `sessions`:
    what it learned from, 0 if only the reference device is known.
    """

    points: tuple[PredictedPoint, ...]
    nearest: tuple[SimilarRow, ...]
    seconds: float | None
    rung: str
    devices: int
    sessions: int


def device_belief(table: CrowdTable, learned: LearnedMap, row: str | None, family: str) -> Belief:
    """The belief about the device of `row` (None: a new device) of `family`."""
    measured = NOTHING if row is None else table.seen.get(row, NOTHING)
    near = relatives(table, row, family)
    return learned.belief.after(measured, [table.configurations_seen[name] for name in near])


def relatives(table: CrowdTable, row: str | None, family: str) -> list[str]:
    """At most MAX_RELATIVES other rows of `family`, those with the most measurements."""
    return [name for name in table.series.get(family, ()) if name != row][:MAX_RELATIVES]


def predict(
    front: Front, table: CrowdTable, learned: LearnedMap, row: str | None, family: str
) -> FrontPrediction:
    """Predict all configurations of `front` on the device of `row`, or (None) on a new device of `family`."""
    belief = device_belief(table, learned, row, family)
    near = nearest(table, row, family)
    if row is None or row not in table.rows.index:
        return _prediction(front, table, learned, belief, None, near, None)
    seconds = float(table.rows.seconds[row])
    return _prediction(front, table, learned, belief, row, near, None if math.isnan(seconds) else seconds)


def predict_similar(
    front: Front,
    table: CrowdTable,
    learned: LearnedMap,
    belief: Belief,
    rows: Sequence[str],
) -> FrontPrediction:
    """Predict all configurations of `front` on a new device similar to `rows`, with `belief`."""
    near = [SimilarRow(row, "it fits the description") for row in rows[:MAX_NEAREST]]
    return _prediction(front, table, learned, belief, None, near, None)


def _prediction(
    front: Front,
    table: CrowdTable,
    learned: LearnedMap,
    belief: Belief,
    row: str | None,
    near: Sequence[SimilarRow],
    seconds: float | None,
) -> FrontPrediction:
    low, high = interval(belief, learned.scale)
    figures = {} if row is None else table.figures(row)
    points = []
    for point in (*front.points, *front.probes):
        probe = point in front.probes
        if point.name == DEFAULT:
            one = PredictedPoint(
                DEFAULT, point.parameters, point.ate_max, 1.0, 1.0, 1.0, row is not None, False
            )
        elif point.name not in table.places:
            continue
        elif point.name in figures:
            one = _measured_point(point, figures[point.name], probe)
        else:
            column = table.places[point.name]
            mean, least, most = (math.exp(float(logs[column])) for logs in (belief.mean, low, high))
            shown = (point.name, point.parameters, point.ate_max)
            one = PredictedPoint(*shown, mean, least, most, False, probe, point.skipped)
        points.append(_with_held_out(one, point, front.point(DEFAULT)))
    return FrontPrediction(
        tuple(points), tuple(near), seconds, learned.rung, learned.devices, learned.sessions
    )


def _with_held_out(one: PredictedPoint, point: Point, default: Point | None) -> PredictedPoint:
    own, beside = (Results((), known.held_out if known else ()) for known in (point, default))
    return replace(one, held_out_ate_max=point.held_out_ate_max, generalises=generalises(own, beside))


def _measured_point(point: Point, figure: Figure, probe: bool) -> PredictedPoint:
    """`point` with the figure that the device measured."""
    half = tables.NORMAL_95 * figure.error
    errors = [error for error in (point.ate_max, figure.ate_max) if error is not None]
    low, high = math.exp(figure.log_ratio - half), math.exp(figure.log_ratio + half)
    ratio, largest = math.exp(figure.log_ratio), max(errors, default=None)
    shown = (point.name, point.parameters, largest)
    return PredictedPoint(*shown, ratio, low, high, True, probe, point.skipped)


def nearest(table: CrowdTable, row: str | None, family: str) -> Sequence[SimilarRow]:
    """At most MAX_NEAREST relatives of `row`, those with the most similar times first."""
    names = relatives(table, row, family)
    if row is None or row not in table.known.ratios.index:
        return [SimilarRow(name, f"its chip is of the series {family}") for name in names[:MAX_NEAREST]]
    ratios = table.known.ratios.to_numpy()
    places = table.known.ratios.index.get_indexer([row, *names])
    apart = np.abs(ratios[places[1:]] - ratios[places[0]])
    common = (~np.isnan(apart)).sum(axis=1)
    with np.errstate(invalid="ignore"):
        differences = np.nansum(apart, axis=1) / common  # NaN without common times, which is sorted last
    rows = []
    for number in np.argsort(differences, kind="stable")[:MAX_NEAREST]:
        why = f"its chip is of the series {family}"
        if common[number]:
            percent = 100 * math.expm1(differences[number])
            why += f"; {common[number]} of its times differ by {percent:.0f} % on average"
        rows.append(SimilarRow(names[number], why))
    return rows
