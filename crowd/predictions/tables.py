"""Tables of figures and stage times that models learn from, with a row for each device and chip.

A table contains the devices that measured one front with one backend and class of processor: times of others
are not comparable.
"""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd
from django.db.models import Count

from crowd.devices.models import Installation
from crowd.fronts.content import plans
from crowd.predictions import measurements
from crowd.predictions.measurements import SESSION_CONFIGURATIONS, STAGE_ERROR, Figure, Group, Row
from pareto.devices.device_map import SEPARATOR, DeviceMap, stage_quantity
from pareto.devices.prediction import Observation
from pareto.devices.rungs import observations
from slam.system import STAGES
from wire.front import BEST, DEFAULT, Front, OnSequence, Point, predicted_speedup

NORMAL_95 = 1.959964
MAX_NEIGHBOURS = 40  # devices of a series that a prediction reads
# A chip's series: its name up to the first digit ("Adreno 6", "Mali-G7").
SERIES = re.compile(r"^\D*\d?")


@dataclass(frozen=True)
class CrowdTable:
    """The measurements of a group's devices.

    `known`: log ratios and errors; rows are named by `Row.name`. `rows` (same index): device (key),
    processor, sessions, seconds (per frame of the default, NaN if unknown). `ate_max` (shape of
    `known.ratios`): errors measured on the device, m, NaN if unknown.
    """

    known: DeviceMap
    rows: pd.DataFrame
    ate_max: pd.DataFrame

    @cached_property
    def places(self) -> dict[str, int]:
        """The column number of each quantity."""
        return {name: column for column, name in enumerate(self.known.ratios.columns)}

    def figures(self, row: str) -> dict[str, Figure]:
        """The figures of `row` by configuration."""
        position = self.known.ratios.index.get_loc(row)
        frames = (self.known.ratios, self.known.errors, self.ate_max)
        values = zip(self.places, *(frame.to_numpy()[position].tolist() for frame in frames), strict=True)
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
        rows: dict[str, list[str]] = {}
        for name in sorted(self.seen, key=lambda name: (-len(self.seen[name]), name)):
            rows.setdefault(str(self.known.families[name]), []).append(name)
        return rows


def chip_series(processor: str) -> str:
    """The series of a chip: its name up to its first digit."""
    match = SERIES.match(processor)
    return match.group().strip() if match else processor


def reference_ratios(front: Front) -> pd.Series:
    """Log ratios of all configurations and stages on the reference device; NaN for unknown stages.

    They are those of the clients' sequence, if the front has them for all points and probes. Otherwise they
    are those of its exploration, which may be over other sequences.
    """
    every = [*front.points, *front.probes]
    times = _sequence_times(every)
    ratios: dict[str, float] = {}
    if times is None:
        default = next((point.predicted for point in every if point.name == DEFAULT), None)
        for point in every:
            ratio = predicted_speedup(default, point.predicted)
            if ratio and point.name != DEFAULT:
                ratios[point.name] = math.log(ratio)
    else:
        ratios = {name: -math.log(one.runtime_ratio) for name, one in times.items() if name != DEFAULT}
    for name in SESSION_CONFIGURATIONS:
        stages = {} if times is None or name not in times else times[name].stages
        for stage in STAGES:
            ratios[stage_quantity(name, stage)] = -math.log(stages[stage]) if stages.get(stage) else math.nan
    return pd.Series(ratios, dtype=float)


def _sequence_times(points: Iterable[Point]) -> dict[str, OnSequence] | None:
    """The times of `points` on the clients' sequence by name; None if one is unknown."""
    times: dict[str, OnSequence] = {}
    for point in points:
        if point.predicted.on_sequence is None:
            return None
        times[point.name] = point.predicted.on_sequence
    return times


def workloads(front: Front, quantities: Iterable[str]) -> pd.DataFrame | None:
    """The workload of each configuration of `front` in `quantities`; None for a system without plans."""
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
    """The stage times of each point and probe of `front` on the reference device, relative to its default.

    None if one is unknown.
    """
    times = _sequence_times([*front.points, *front.probes])
    if times is None:
        return None
    table = pd.DataFrame({name: pd.Series(one.stages, dtype=float) for name, one in times.items()}).T
    table = table.reindex(columns=list(STAGES))
    return None if table.isna().any(axis=None) else table


def is_predictable(front: Front) -> bool:
    """Whether the reference device measured the times of default and best of `front`."""
    return BEST in reference_ratios(front)


def read_table(
    front: Front,
    group: Group,
    devices: Sequence[int] | None = None,
    installation: Installation | None = None,
) -> CrowdTable:
    """Read the table of `group` for `front`; only of `devices` (keys), if given.

    What `installation` measured replaces what others measured on its device. Three queries, two more for
    `installation` and, the first time, the plans of all configurations.
    """
    first_frame = front.protocol.first_counted_frame
    sources = [measurements.read(group, first_frame, devices)]
    if installation is not None:
        sources.append(measurements.read_own(group, first_frame, installation))
    figures: dict[tuple[Row, str], Figure] = {}
    sessions: dict[Row, int] = {}
    stages: dict[tuple[str, str], float] = {}
    seconds: dict[str, float] = {}
    for one in sources:
        figures |= one.figures
        sessions |= one.sessions
        stages |= {(row, quantity): ratio for row, quantity, ratio in one.stages.itertuples(index=False)}
        seconds |= one.seconds.to_dict()
    reference = reference_ratios(front)
    names = [row.name for row in sessions]
    lines = [(row.name, name, *figure) for (row, name), figure in figures.items()]
    lines += [(row, quantity, ratio, STAGE_ERROR, None) for (row, quantity), ratio in stages.items()]
    measured = pd.DataFrame(lines, columns=["row", "quantity", "ratio", "error", "ate_max"])

    def table(values: str) -> pd.DataFrame:
        wide = measured.pivot(index="row", columns="quantity", values=values)
        return wide.reindex(index=rows.index, columns=reference.index).astype(float)

    rows = pd.DataFrame(
        {
            "device": [row.device for row in sessions],
            "processor": [row.processor for row in sessions],
            "sessions": list(sessions.values()),
            "seconds": [seconds.get(name, math.nan) for name in names],
        },
        index=pd.Index(names, name="row", dtype=object),
    ).sort_index()
    families = rows.processor.map(chip_series).astype(object)
    device_map = DeviceMap(
        table("ratio"),
        table("error"),
        families,
        reference,
        workloads(front, reference.index),
        reference_stage_times(front),
    )
    return CrowdTable(device_map, rows, table("ate_max"))


def neighbours(group: Group, processor: str, device: int | None = None) -> list[int]:
    """The keys of `device` and of at most MAX_NEIGHBOURS devices of `group` whose chip is of `processor`'s
    series.

    Devices with the most figures come first. One query.
    """
    figures = measurements.group_figures(group).filter(processor__startswith=chip_series(processor))
    near = figures.values("device").annotate(count=Count("pk")).order_by("-count", "device")
    asked = [] if device is None else [device]
    return [*asked, *(key for key in near.values_list("device", flat=True)[:MAX_NEIGHBOURS] if key != device)]
