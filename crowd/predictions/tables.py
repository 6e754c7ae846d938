"""The crowd's figures and stage times as the tables that models learn from: a row for each cohort of devices.

Devices that measured one front with one backend and one class of processor are in one table: times of others
say nothing of theirs. Simulated devices are never in one table with those that people have.
"""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from django.db.models import BooleanField, Count, ExpressionWrapper, Max, QuerySet

from crowd.devices.models import DeviceModel
from crowd.fronts.content import plans
from crowd.fronts.models import FrontVersion
from crowd.fronts.selectors import BEST, DEFAULT, Front, Point, predicted_speedup
from crowd.results.figures.confirmation import confirmed
from crowd.results.intake import packing
from crowd.results.models import Cohort, DeviceSpeedup, Run, SessionSummary, State
from crowd.results.models.derived import standard_error
from crowd.results.reading.public_rows import simulated_only
from pareto.devices.device_map import SEPARATOR, DeviceMap, stage_quantity
from pareto.devices.prediction import Observation
from pareto.devices.rungs import observations
from slam.system import STAGES

SESSION = (DEFAULT, BEST)  # what every session measures, with its stages
# Standard errors of logarithms: of the stages of a session, and what is added where no quorum agrees.
STAGE, UNCONFIRMED = 0.05, 0.05
NORMAL_95 = 1.959964
FIGURE = ("row", "device", "processor", "quantity", "ratio", "error", "ate_max", "sessions")
MOST_NEAR = 40  # devices of a series that a prediction looks at
# A chip's family: its name up to the first digit, which tells series apart ("Adreno 6", "Mali-G7").
SERIES = re.compile(r"^\D*\d?")


@dataclass(frozen=True)
class Group:
    """Which devices are in one table."""

    front: int
    backend: str
    processor_class: str
    simulated: bool


class Figure(NamedTuple):
    """What a device measured of a configuration: `log_ratio` with its standard error, and `ate_max` (m), None
    where it did not tell.
    """

    log_ratio: float
    error: float
    ate_max: float | None


@dataclass(frozen=True)
class CrowdTable:
    """`known`: what the devices of a group measured; its rows are named by `row_name`. `rows` (the same
    index): device (key), processor, sessions, seconds (of a frame of the default, NaN where unknown).
    `ate_max` (the shape of `known.ratios`): errors that a device measured itself, m, NaN where it did not.
    """

    known: DeviceMap
    rows: pd.DataFrame
    ate_max: pd.DataFrame

    @cached_property
    def places(self) -> dict[str, int]:
        """The place of each quantity."""
        return {name: place for place, name in enumerate(self.known.ratios.columns)}

    def figures(self, row: str) -> dict[str, Figure]:
        """What ROW measured, by configuration."""
        place = self.known.ratios.index.get_loc(row)
        frames = (self.known.ratios, self.known.errors, self.ate_max)
        values = zip(self.places, *(frame.to_numpy()[place].tolist() for frame in frames), strict=True)
        return {
            name: Figure(log, error, None if math.isnan(ate_max) else ate_max)
            for name, log, error, ate_max in values
            if not math.isnan(log) and SEPARATOR not in name
        }

    @cached_property
    def seen(self) -> dict[str, Observation]:
        """What each row measured, stages too."""
        return dict(zip(self.known.ratios.index, observations(self.known), strict=True))

    @cached_property
    def configurations_seen(self) -> dict[str, Observation]:
        """The same without stages."""
        whole = np.array([SEPARATOR not in name for name in self.known.ratios.columns], dtype=bool)
        return {
            name: Observation(one.places[kept], one.values[kept], one.errors[kept])
            for name, one in self.seen.items()
            for kept in [whole[one.places]]
        }

    @cached_property
    def series(self) -> dict[str, list[str]]:
        """The rows of each family, those with most measurements first."""
        found: dict[str, list[str]] = {}
        for name in sorted(self.seen, key=lambda name: (-len(self.seen[name]), name)):
            found.setdefault(str(self.known.families[name]), []).append(name)
        return found


def row_name(device: int, processor: str) -> str:
    """The row of the cohort of DEVICE whose chip PROCESSOR computed."""
    return f"{device} {processor}"


def family(processor: str) -> str:
    """The series of a chip: its name up to its first digit."""
    found = SERIES.match(processor)
    return found.group().strip() if found else processor


def reference_of(front: Front) -> pd.Series:
    """Log ratios of every configuration and stage on the reference device; stages are NaN where unknown.

    They are those of the clients' sequence where the front has them for each point and probe; else those of
    its exploration, which may be over other sequences.
    """
    every = [*front.points, *front.probes]
    times = _on_sequence(every)
    found: dict[str, float] = {}
    if times is None:
        default = next((point.predicted for point in every if point.name == DEFAULT), {})
        for point in every:
            ratio = predicted_speedup(default, point.predicted)
            if ratio and point.name != DEFAULT:
                found[point.name] = math.log(ratio)
    else:
        found = {name: -math.log(one["runtime_ratio"]) for name, one in times.items() if name != DEFAULT}
    for name in SESSION:
        stages = {} if times is None or name not in times else times[name]["stages"]
        for stage in STAGES:
            found[stage_quantity(name, stage)] = -math.log(stages[stage]) if stages.get(stage) else math.nan
    return pd.Series(found, dtype=float)


def _on_sequence(points: Iterable[Point]) -> dict[str, dict[str, Any]] | None:
    """The times of POINTS on the clients' sequence, by name; None where one has none."""
    found = {point.name: point.predicted.get("on_sequence") for point in points}
    return None if None in found.values() else {name: dict(one or {}) for name, one in found.items()}


def work_of(front: Front, quantities: Iterable[str]) -> pd.DataFrame | None:
    """How much each configuration of FRONT among QUANTITIES computes; None for a system without plans."""
    wanted = {DEFAULT, *quantities}
    loads: dict[str, Mapping[tuple[str, str], float]] = {}
    for point in (*front.points, *front.probes):
        if point.name in wanted:
            load = plans.workload(front, point)
            if load is None:
                return None
            loads[point.name] = load
    columns = sorted({key for load in loads.values() for key in load})
    units = [[load.get(key, 0.0) for key in columns] for load in loads.values()]
    return pd.DataFrame(units, index=list(loads), columns=pd.MultiIndex.from_tuples(columns))


def stage_times_of(front: Front) -> pd.DataFrame | None:
    """The stages of each point and probe of FRONT on the reference device, in units of the time of its
    default; None where one is unknown.
    """
    times = _on_sequence([*front.points, *front.probes])
    if times is None:
        return None
    table = pd.DataFrame({name: pd.Series(one["stages"], dtype=float) for name, one in times.items()}).T
    table = table.reindex(columns=list(STAGES))
    return None if table.isna().any(axis=None) else table


def is_predictable(front: Front) -> bool:
    """Whether the reference device timed the default and best of FRONT."""
    return BEST in reference_of(front)


def groups() -> list[Group]:
    """Every group that measured a published front. One query."""
    rows = Cohort.objects.filter(front__state=FrontVersion.State.PUBLISHED).order_by()
    found = rows.values_list("front_id", "backend", "processor_class", "device__kind").distinct()
    return sorted(
        {
            Group(front, backend, kind, device == DeviceModel.Kind.SIMULATED)
            for front, backend, kind, device in found
        },
        key=lambda group: (group.front, group.backend, group.processor_class, group.simulated),
    )


def read(front: Front, group: Group, devices: Sequence[int] | None = None) -> CrowdTable:
    """What the devices of GROUP measured of FRONT; of DEVICES (keys) alone where they are given. Three
    queries and, the first time, the plans of all configurations.
    """
    reference = reference_of(front)
    figures, stages = _figures(group, devices), _stages(front, group, devices)
    measured = pd.concat([figures, stages[stages.row.isin(figures.row)]], ignore_index=True)
    measured = measured[measured.quantity.isin(reference.index)]

    def table(values: str) -> pd.DataFrame:
        wide = measured.pivot(index="row", columns="quantity", values=values)
        return wide.reindex(index=rows.index, columns=reference.index).astype(float)

    rows = figures.groupby("row").agg(
        device=("device", "first"), processor=("processor", "first"), sessions=("sessions", "max")
    )
    rows["seconds"] = stages.groupby("row").seconds.first().reindex(rows.index)
    families = rows.processor.map(family).astype(object)
    known = DeviceMap(
        table("ratio"),
        table("error"),
        families,
        reference,
        work_of(front, reference.index),
        stage_times_of(front),
    )
    return CrowdTable(known, rows, table("ate_max"))


def neighbourhood(group: Group, processor: str, device: int | None = None) -> list[int]:
    """The keys of DEVICE and of the devices of GROUP with chips of the series of PROCESSOR: those with most
    figures, MOST_NEAR at most. One query.
    """
    series = cohorts(group).filter(processor__startswith=family(processor))
    figures = DeviceSpeedup.objects.filter(
        front=group.front, backend=group.backend, device__in=series.values("device")
    )
    near = figures.order_by().values("device").annotate(count=Count("pk")).order_by("-count", "device")
    own = [] if device is None else [device]
    return [*own, *(key for key in near.values_list("device", flat=True)[:MOST_NEAR] if key != device)]


def cohorts(group: Group) -> QuerySet[Cohort]:
    """The cohorts of GROUP."""
    return Cohort.objects.filter(
        simulated_only(group.simulated),
        front=group.front,
        backend=group.backend,
        processor_class=group.processor_class,
    )


def _figures(group: Group, devices: Sequence[int] | None) -> pd.DataFrame:
    """A line for each valid figure: row, device, processor, quantity, ratio, error, ate_max, sessions."""
    found = DeviceSpeedup.objects.filter(
        simulated_only(group.simulated),
        front=group.front,
        backend=group.backend,
        processor_class=group.processor_class,
        state=State.VALID,
    )
    if devices is not None:
        found = found.filter(device__in=devices)
    read = found.order_by().annotate(agreed=ExpressionWrapper(confirmed(), BooleanField()))
    lines = [
        (row_name(device, chip), device, chip, name, math.log(speedup), _error(*uncertain), ate_max, sessions)
        for device, chip, name, speedup, ate_max, sessions, *uncertain in read.values_list(
            *("device", "processor", "configuration__name", "speedup", "ate_max", "sessions"),
            *("deviation", "units", "session_low", "session_high", "agreed"),
        ).iterator()
    ]
    return pd.DataFrame(lines, columns=list(FIGURE))


def _error(deviation: float | None, units: int, low: float | None, high: float | None, agreed: bool) -> float:
    """The standard error of a figure's logarithm; larger where no quorum AGREED with it."""
    own = standard_error(deviation, units, low, high)
    return own if agreed else math.hypot(own, UNCONFIRMED)


def _stages(front: Front, group: Group, devices: Sequence[int] | None) -> pd.DataFrame:
    """A line for each stage of the default and best in the newest session of each row that counts: row,
    quantity, ratio, error, and the seconds of a frame of the default.
    """
    first = int(front.protocol["first_counted_frame"])
    newest = SessionSummary.objects.filter(
        cohort__front=group.front,
        cohort__backend=group.backend,
        cohort__processor_class=group.processor_class,
        configuration__name=BEST,
        state=State.VALID,
    )
    if devices is not None:
        newest = newest.filter(cohort__device__in=devices)
    keys = newest.order_by().values("cohort").annotate(newest=Max("session")).values("newest")
    runs = Run.objects.filter(
        session__in=keys, configuration__name__in=SESSION, status=Run.Status.OK, state=State.VALID
    )
    columns = (
        "session__device",
        "session__processor",
        "configuration__name",
        "mean_us",
        "stages",
        "stages_us",
    )
    times: list[tuple[str, str, float]] = []
    for device, processor, name, mean_us, stages, packed in runs.order_by().values_list(*columns).iterator():
        row = row_name(device, processor)
        times.append((row, name, mean_us / 1e6))
        for stage, series in packing.unpack_stages(stages, packed).items():
            if stage in STAGES:
                times.append((row, stage_quantity(name, stage), float(series[first:].mean()) / 1e6))
    mean = pd.DataFrame(times, columns=["row", "quantity", "time"]).groupby(["row", "quantity"]).time.mean()
    default = mean[mean.index.get_level_values("quantity") == DEFAULT].droplevel("quantity")
    found = mean[mean > 0].reset_index()
    found["seconds"] = found.row.map(default)
    found = found[found.quantity.str.contains(SEPARATOR, regex=False) | (found.quantity == DEFAULT)]
    found["ratio"] = np.log(found.seconds / found.time)
    found["error"] = STAGE
    return found.drop(columns="time")
