"""Predicts the speedup of each configuration on a device, from its own figures and those of relatives."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from crowd.fronts.content.generalisation import Results, generalises
from crowd.predictions import tables
from crowd.predictions.tables import CrowdTable
from crowd.records.record import Record
from pareto.devices.ladder import interval
from pareto.devices.prediction import Belief, Observation
from wire.front import DEFAULT, Front
from wire.meaning import means

MAX_RELATIVES = 8  # of a family, those with the most measurements
MAX_NEAREST = 3
NOTHING = Observation(np.array([], dtype=np.intp), np.array([]), np.array([]))


class PredictedPoint(Record, frozen=True, kw_only=True):
    """A configuration on one device: its speedup over the default, with a 95 % interval.

    `measured`: the device measured it, and the interval is that of its figure. `ate_max` (m): the
    largest error on the sequences that the front was learned on, or that the device measured; None without a
    known error. `skipped`: the share of the frames that it left out on the reference device; None if it
    computes all. `held_out_ate_max` (m): the largest error on held-out sequences; None without one.
    `generalises`: it is not much worse than the default there.
    """

    configuration: Annotated[str, means("name of the configuration in the front")]
    parameters: Annotated[dict[str, Any], means("values by the names of the parameters")]
    ate_max: Annotated[float | None, means("largest distance of the camera from its true place", "m")]
    held_out_ate_max: Annotated[float | None, means("the same on held-out sequences", "m")] = None
    ratio: Annotated[float, means("how many times faster than the default")]
    low: Annotated[float, means("lower end of the 95 % interval")]
    high: Annotated[float, means("upper end of the 95 % interval")]
    measured: bool
    probe: bool
    skipped: float | None = None
    generalises: bool = True

    @property
    def state(self) -> Annotated[str, means("measured or predicted")]:
        """measured or predicted."""
        return "measured" if self.measured else "predicted"


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
    default = front.point(DEFAULT)
    points = []
    for point in front.content.every:
        figure = None if point.name == DEFAULT else figures.get(point.name)
        if point.name == DEFAULT:
            logs = [0.0, 0.0, 0.0]
        elif point.name not in table.places:
            continue
        elif figure is not None:
            half = tables.NORMAL_95 * figure.error
            logs = [figure.log_ratio, figure.log_ratio - half, figure.log_ratio + half]
        else:
            logs = [float(each[table.places[point.name]]) for each in (belief.mean, low, high)]
        ratio, least, most = map(math.exp, logs)
        errors = [error for error in (point.ate_max, figure and figure.ate_max) if error is not None]
        own, beside = (Results((), known.held_out if known else ()) for known in (point, default))
        points.append(
            PredictedPoint(
                configuration=point.name,
                parameters=point.parameters,
                ate_max=max(errors, default=None),
                held_out_ate_max=point.held_out_ate_max,
                ratio=ratio,
                low=least,
                high=most,
                measured=figure is not None or (point.name == DEFAULT and row is not None),
                probe=point in front.probes,
                skipped=point.skipped,
                generalises=generalises(own, beside),
            )
        )
    return FrontPrediction(
        tuple(points), tuple(near), seconds, learned.rung, learned.devices, learned.sessions
    )


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
