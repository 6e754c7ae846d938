"""What a device's own figures and its relatives let expect of every configuration of a front."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from crowd.fronts.selectors import DEFAULT, Front, Point
from crowd.predictions import tables
from crowd.predictions.tables import CrowdTable, Figure
from pareto.devices.ladder import interval
from pareto.devices.prediction import Belief, Observation

MOST_RELATIVES = 8  # of a family that a prediction rests on, those with most measurements
NEAREST = 3
NOTHING = Observation(np.array([], dtype=np.intp), np.array([]), np.array([]))


@dataclass(frozen=True)
class Expected:
    """A configuration on one device: how many times faster than the default, with its 95 % interval.

    `measured`: the device measured it itself; the interval is then that of the figure. `ate_max` (m) is the
    largest that the reference predicts or measured on any sequence, or the device measured; None where no
    error is known.
    """

    configuration: str
    parameters: dict[str, Any]
    ate_max: float | None
    ratio: float
    low: float
    high: float
    measured: bool
    probe: bool


@dataclass(frozen=True)
class Learned:
    """What the devices of a group taught: `belief` is about one that was never seen.

    Intervals are `scale` times as wide as beliefs say. `devices` and `sessions` are none where the reference
    alone speaks.
    """

    rung: str
    belief: Belief
    scale: float
    devices: int = 0
    sessions: int = 0


@dataclass(frozen=True)
class Near:
    """A row of the table that is like a device, and why."""

    row: str
    why: str


@dataclass(frozen=True)
class Expectation:
    """Every configuration of a front on one device, the default first; `nearest` rows, the nearest first.

    `seconds`: what a frame of the default takes on it; None where nobody measured that. `rung` is the model,
    `devices` and `sessions` what it learned from: none where the reference alone speaks.
    """

    points: tuple[Expected, ...]
    nearest: tuple[Near, ...]
    seconds: float | None
    rung: str
    devices: int
    sessions: int


def belief_of(table: CrowdTable, learned: Learned, row: str | None, family: str) -> Belief:
    """The belief about the device of ROW (None: one that nobody measured) of FAMILY."""
    own = NOTHING if row is None else table.seen.get(row, NOTHING)
    near = relatives(table, row, family)
    return learned.belief.after(own, [table.configurations_seen[name] for name in near])


def relatives(table: CrowdTable, row: str | None, family: str) -> list[str]:
    """The other rows of FAMILY with most measurements, MOST_RELATIVES at most."""
    return [name for name in table.series.get(family, ()) if name != row][:MOST_RELATIVES]


def expect(front: Front, table: CrowdTable, learned: Learned, row: str | None, family: str) -> Expectation:
    """What to expect of every configuration of FRONT on the device of ROW, or on a new one of FAMILY."""
    belief = belief_of(table, learned, row, family)
    near = nearest(table, row, family)
    if row is None or row not in table.rows.index:
        return _expectation(front, table, learned, belief, None, near, None)
    seconds = float(table.rows.seconds[row])
    return _expectation(front, table, learned, belief, row, near, None if math.isnan(seconds) else seconds)


def expect_of(
    front: Front,
    table: CrowdTable,
    learned: Learned,
    belief: Belief,
    rows: Sequence[str],
) -> Expectation:
    """The same on a further device like those of ROWS, of which BELIEF is held."""
    near = [Near(row, "it fits the description") for row in rows[:NEAREST]]
    return _expectation(front, table, learned, belief, None, near, None)


def _expectation(
    front: Front,
    table: CrowdTable,
    learned: Learned,
    belief: Belief,
    row: str | None,
    near: Sequence[Near],
    seconds: float | None,
) -> Expectation:
    low, high = interval(belief, learned.scale)
    own = {} if row is None else table.figures(row)
    points = []
    for point in (*front.points, *front.probes):
        probe = point in front.probes
        if point.name == DEFAULT:
            one = Expected(
                DEFAULT, point.parameters, point.largest_ate, 1.0, 1.0, 1.0, row is not None, False
            )
        elif point.name not in table.places:
            continue
        elif point.name in own:
            one = _measured(point, own[point.name], probe)
        else:
            place = table.places[point.name]
            mean, least, most = (math.exp(float(logs[place])) for logs in (belief.mean, low, high))
            one = Expected(point.name, point.parameters, point.largest_ate, mean, least, most, False, probe)
        points.append(one)
    return Expectation(tuple(points), tuple(near), seconds, learned.rung, learned.devices, learned.sessions)


def _measured(point: Point, figure: Figure, probe: bool) -> Expected:
    """POINT with what the device measured itself."""
    half = tables.NORMAL_95 * figure.error
    known = [error for error in (point.largest_ate, figure.ate_max) if error is not None]
    low, high = math.exp(figure.log_ratio - half), math.exp(figure.log_ratio + half)
    ratio, largest = math.exp(figure.log_ratio), max(known, default=None)
    return Expected(point.name, point.parameters, largest, ratio, low, high, True, probe)


def nearest(table: CrowdTable, row: str | None, family: str) -> Sequence[Near]:
    """The relatives of ROW, NEAREST at most: those whose times differ least from its own first."""
    names = relatives(table, row, family)
    if row is None or row not in table.known.ratios.index:
        return [Near(name, f"its chip is of the series {family}") for name in names[:NEAREST]]
    ratios = table.known.ratios.to_numpy()
    places = table.known.ratios.index.get_indexer([row, *names])
    apart = np.abs(ratios[places[1:]] - ratios[places[0]])
    common = (~np.isnan(apart)).sum(axis=1)
    with np.errstate(invalid="ignore"):
        differences = np.nansum(apart, axis=1) / common  # NaN, which comes last, where nothing is common
    found = []
    for number in np.argsort(differences, kind="stable")[:NEAREST]:
        why = f"its chip is of the series {family}"
        if common[number]:
            percent = 100 * math.expm1(differences[number])
            why += f"; {common[number]} of its times differ by {percent:.0f} % on average"
        found.append(Near(names[number], why))
    return found
