"""Tables of figures and stage times that models learn from, with a row for each cohort.

A table contains the devices that measured one front with one backend and class of processor: times of others
are not comparable. Simulated and real devices are never in one table.
"""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from django.db.models import BooleanField, Count, ExpressionWrapper, QuerySet

from crowd.devices.models import DeviceModel
from crowd.fronts.content import plans
from crowd.fronts.models import FrontVersion
from crowd.fronts.selectors import BEST, DEFAULT, Front, Point, predicted_speedup
from crowd.results.figures.confirmation import confirmed
from crowd.results.intake import packing
from crowd.results.models import Cohort, DeviceSpeedup, Run, State
from crowd.results.reading.newest_times import newest_sessions
from crowd.results.reading.public_rows import simulated_only
from crowd.results.uncertainty import figure_estimate
from pareto.devices.device_map import SEPARATOR, DeviceMap, stage_quantity
from pareto.devices.prediction import Observation
from pareto.devices.rungs import observations
from slam.system import STAGES

SESSION_CONFIGURATIONS = (DEFAULT, BEST)  # what every session measures, including stages
# Standard errors of logarithms: of a session's stages, and in addition for unconfirmed figures.
STAGE_ERROR, UNCONFIRMED = 0.05, 0.05
NORMAL_95 = 1.959964
FIGURE_COLUMNS = ("row", "device", "processor", "quantity", "ratio", "error", "ate_max", "sessions")
MAX_NEIGHBOURS = 40  # devices of a series that a prediction reads
# A chip's series: its name up to the first digit ("Adreno 6", "Mali-G7").
SERIES = re.compile(r"^\D*\d?")


@dataclass(frozen=True)
class Group:
    """The devices that are in one table."""

    front: int
    backend: str
    processor_class: str
    simulated: bool


class Figure(NamedTuple):
    """A device's figure of a configuration: log ratio, its standard error, and error (m), None if unknown."""

    log_ratio: float
    error: float
    ate_max: float | None


@dataclass(frozen=True)
class CrowdTable:
    """The measurements of a group's devices.

    `known`: log ratios and errors; rows are named by `row_name`. `rows` (same index): device (key),
    processor, sessions, seconds (per frame of the default, NaN if unknown). `ate_max` (shape of
    `known.ratios`): errors measured on the device, m, NaN if unknown.
    """

    known: DeviceMap
    rows: pd.DataFrame
    ate_max: pd.DataFrame

    @cached_property
    def places(self) -> dict[str, int]:
        """The column number of each quantity."""
        return {name: place for place, name in enumerate(self.known.ratios.columns)}

    def figures(self, row: str) -> dict[str, Figure]:
        """The figures of ROW by configuration."""
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
        """The measurements of each row, with stages."""
        return dict(zip(self.known.ratios.index, observations(self.known), strict=True))

    @cached_property
    def configurations_seen(self) -> dict[str, Observation]:
        """The measurements of each row, without stages."""
        whole = np.array([SEPARATOR not in name for name in self.known.ratios.columns], dtype=bool)
        return {
            name: Observation(one.places[kept], one.values[kept], one.errors[kept])
            for name, one in self.seen.items()
            for kept in [whole[one.places]]
        }

    @cached_property
    def series(self) -> dict[str, list[str]]:
        """The rows of each family, those with the most measurements first."""
        found: dict[str, list[str]] = {}
        for name in sorted(self.seen, key=lambda name: (-len(self.seen[name]), name)):
            found.setdefault(str(self.known.families[name]), []).append(name)
        return found


def row_name(device: int, processor: str) -> str:
    """The name of the row of DEVICE (a key) with the chip PROCESSOR."""
    return f"{device} {processor}"


def chip_series(processor: str) -> str:
    """The series of a chip: its name up to its first digit."""
    found = SERIES.match(processor)
    return found.group().strip() if found else processor


def reference_ratios(front: Front) -> pd.Series:
    """Log ratios of all configurations and stages on the reference device; NaN for unknown stages.

    They are those of the clients' sequence, if the front has them for all points and probes. Otherwise they
    are those of its exploration, which may be over other sequences.
    """
    every = [*front.points, *front.probes]
    times = _sequence_times(every)
    found: dict[str, float] = {}
    if times is None:
        default = next((point.predicted for point in every if point.name == DEFAULT), {})
        for point in every:
            ratio = predicted_speedup(default, point.predicted)
            if ratio and point.name != DEFAULT:
                found[point.name] = math.log(ratio)
    else:
        found = {name: -math.log(one["runtime_ratio"]) for name, one in times.items() if name != DEFAULT}
    for name in SESSION_CONFIGURATIONS:
        stages = {} if times is None or name not in times else times[name]["stages"]
        for stage in STAGES:
            found[stage_quantity(name, stage)] = -math.log(stages[stage]) if stages.get(stage) else math.nan
    return pd.Series(found, dtype=float)


def _sequence_times(points: Iterable[Point]) -> dict[str, dict[str, Any]] | None:
    """The times of POINTS on the clients' sequence by name; None if one is unknown."""
    found = {point.name: point.predicted.get("on_sequence") for point in points}
    return None if None in found.values() else {name: dict(one or {}) for name, one in found.items()}


def workloads(front: Front, quantities: Iterable[str]) -> pd.DataFrame | None:
    """The workload of each configuration of FRONT in QUANTITIES; None for a system without plans."""
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


def reference_stage_times(front: Front) -> pd.DataFrame | None:
    """The stage times of each point and probe of FRONT on the reference device, relative to its default.

    None if one is unknown.
    """
    times = _sequence_times([*front.points, *front.probes])
    if times is None:
        return None
    table = pd.DataFrame({name: pd.Series(one["stages"], dtype=float) for name, one in times.items()}).T
    table = table.reindex(columns=list(STAGES))
    return None if table.isna().any(axis=None) else table


def is_predictable(front: Front) -> bool:
    """Whether the reference device measured the times of default and best of FRONT."""
    return BEST in reference_ratios(front)


def groups() -> list[Group]:
    """All groups that measured a published front. One query."""
    rows = Cohort.objects.filter(front__state=FrontVersion.State.PUBLISHED).order_by()
    found = rows.values_list("front_id", "backend", "processor_class", "device__kind").distinct()
    return sorted(
        {
            Group(front, backend, kind, device == DeviceModel.Kind.SIMULATED)
            for front, backend, kind, device in found
        },
        key=lambda group: (group.front, group.backend, group.processor_class, group.simulated),
    )


def read_table(front: Front, group: Group, devices: Sequence[int] | None = None) -> CrowdTable:
    """Read the table of GROUP for FRONT; only of DEVICES (keys), if given.

    Three queries and, the first time, the plans of all configurations.
    """
    reference = reference_ratios(front)
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
    families = rows.processor.map(chip_series).astype(object)
    known = DeviceMap(
        table("ratio"),
        table("error"),
        families,
        reference,
        workloads(front, reference.index),
        reference_stage_times(front),
    )
    return CrowdTable(known, rows, table("ate_max"))


def neighbours(group: Group, processor: str, device: int | None = None) -> list[int]:
    """The keys of DEVICE and of at most MAX_NEIGHBOURS devices of GROUP whose chip is of PROCESSOR's series.

    Devices with the most figures come first. One query.
    """
    series = group_cohorts(group).filter(processor__startswith=chip_series(processor))
    figures = DeviceSpeedup.objects.filter(
        front=group.front, backend=group.backend, device__in=series.values("device")
    )
    near = figures.order_by().values("device").annotate(count=Count("pk")).order_by("-count", "device")
    own = [] if device is None else [device]
    return [*own, *(key for key in near.values_list("device", flat=True)[:MAX_NEIGHBOURS] if key != device)]


def group_cohorts(group: Group) -> QuerySet[Cohort]:
    """The cohorts of GROUP."""
    return Cohort.objects.filter(
        simulated_only(group.simulated),
        front=group.front,
        backend=group.backend,
        processor_class=group.processor_class,
    )


def _figures(group: Group, devices: Sequence[int] | None) -> pd.DataFrame:
    """A row for each valid figure: row, device, processor, quantity, ratio, error, ate_max, sessions."""
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
        (
            row_name(device, chip),
            device,
            chip,
            name,
            *_figure(math.log(speedup), *uncertain),
            ate_max,
            sessions,
        )
        for device, chip, name, speedup, ate_max, sessions, *uncertain in read.values_list(
            *("device", "processor", "configuration__name", "speedup", "ate_max", "sessions"),
            *("deviation", "units", "session_low", "session_high", "agreed"),
        ).iterator()
    ]
    return pd.DataFrame(lines, columns=list(FIGURE_COLUMNS))


def _figure(
    log: float, deviation: float | None, units: int, low: float | None, high: float | None, agreed: bool
) -> tuple[float, float]:
    """A figure's logarithm with its standard error; larger unless a quorum AGREED."""
    own = figure_estimate(log, deviation, units, low, high).error
    return log, own if agreed else math.hypot(own, UNCONFIRMED)


def _stages(front: Front, group: Group, devices: Sequence[int] | None) -> pd.DataFrame:
    """A row for each stage of default and best in the newest valid session: row, quantity, ratio, error, and
    the seconds per frame of the default.
    """
    first = int(front.protocol["first_counted_frame"])
    cohorts = group_cohorts(group)
    if devices is not None:
        cohorts = cohorts.filter(device__in=devices)
    runs = Run.objects.filter(
        session__in=newest_sessions(cohorts),
        configuration__name__in=SESSION_CONFIGURATIONS,
        status=Run.Status.OK,
        state=State.VALID,
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
    found["error"] = STAGE_ERROR
    return found.drop(columns="time")
