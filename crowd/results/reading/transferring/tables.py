"""The speedups of a front's configurations on all devices, as a table, from which transfer is read."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowd.devices import revision
from crowd.devices.naming.chips import vendor
from crowd.fronts.models import Configuration
from crowd.records.device import Device
from crowd.results.figures.cohorts import figures
from crowd.results.models import DeviceSpeedup, SessionSummary, State
from crowd.results.public_rows import is_confirmed, read_devices
from crowd.results.reading.queries.filters import ALL, SpeedupFilters
from crowd.results.reading.speedups import front_cohorts, matches, measured_front, period_bounds
from crowd.results.reading.versioned_cache import VersionedCache


class Measured(NamedTuple):
    """A device with what computed on it."""

    device: Device
    backend: str
    processor: str


class TableCell(NamedTuple):
    """A valid figure: the log speedup of a configuration over the baseline on a device."""

    on: Measured
    configuration: str
    baseline: str
    log_speedup: float
    sessions: int
    confirmed: bool


@dataclass(frozen=True)
class SpeedupTable:
    """Log speedups over the default (devices, configurations): NaN without a confirmed figure.

    One row per device: of several processors, that with the most configurations, then sessions.
    `unconfirmed`: the number of other devices with enough figures that are valid, but not confirmed.
    """

    front: str | None
    devices: tuple[Device, ...]  # in the order of their slugs
    backends: tuple[str, ...]
    processors: tuple[str, ...]
    sessions: tuple[int, ...]  # of the configuration with the most
    configurations: tuple[str, ...]
    log_speedups: NDArray[np.float64]
    unconfirmed: int


# A table of 2,000 devices and 20 configurations takes 1 MB.
_cache: VersionedCache[SpeedupTable] = VersionedCache(8)


def speedup_table(filters: SpeedupFilters, least: int, probes: bool = True) -> SpeedupTable:
    """The confirmed figures under `filters` of devices with at least `least` configurations, default
    included.

    The configuration of `filters` is ignored. `probes`: include the front's probes. At most nine queries; at
    most four if nothing changed since the last call of this process. Figures of a period are cached, too:
    their summaries change only together with stored figures.
    """
    front = filters.front or measured_front(filters.application)
    filters = replace(filters, front=front or "", configuration=ALL, suspect=False)
    return _cache.get(
        revision.current, (filters.query(), least, probes), lambda: _table(filters, front, least, probes)
    )


def _table(filters: SpeedupFilters, front: str | None, least: int, probes: bool) -> SpeedupTable:
    read = _period_cells if filters.period else _stored_cells
    cells = list(read(filters, front, {} if probes else {"probe": False})) if filters.apply_here else []
    chosen = _choose_rows((cell for cell in cells if cell.confirmed), least)
    unconfirmed = _choose_rows(cells, least).keys() - chosen.keys()
    names = sorted({name for row in chosen.values() for name in row.logs})
    columns = {name: column for column, name in enumerate(names)}
    values = np.full((len(chosen), len(names)), np.nan)
    for number, row in enumerate(chosen.values()):
        for name, log in row.logs.items():
            values[number, columns[name]] = log
    # Many requests share the array.
    values.flags.writeable = False
    rows = list(chosen.values())
    return SpeedupTable(
        front=front,
        devices=tuple(row.on.device for row in rows),
        backends=tuple(row.on.backend for row in rows),
        processors=tuple(row.on.processor for row in rows),
        sessions=tuple(row.sessions for row in rows),
        configurations=tuple(names),
        log_speedups=values,
        unconfirmed=len(unconfirmed),
    )


@dataclass
class _Row:
    on: Measured
    logs: dict[str, float]
    sessions: int = 0


def _stored_cells(
    filters: SpeedupFilters, front: str | None, which: Mapping[str, bool]
) -> Iterable[TableCell]:
    """Cells from stored figures. `which` filters configurations. Reads columns only, for speed."""
    rows = DeviceSpeedup.objects.filter(
        front__slug=front,
        state=State.VALID,
        sessions__gte=filters.min_sessions,
        **{f"configuration__{name}": value for name, value in which.items()},
    ).order_by()
    lines = list(
        rows.values_list(
            "device_id",
            "backend",
            "processor",
            "processor_class",
            "configuration__name",
            "baseline__name",
            "speedup",
            "sessions",
            "witnesses",
            "chip_witnesses",
        )
    )
    devices = read_devices(row[0] for row in lines)
    for key, backend, processor, kind, configuration, baseline, speedup, sessions, own, chip in lines:
        device = devices[key]
        if matches(filters, device, vendor(processor, device.gpu, kind), backend):
            sure = is_confirmed(own, chip)
            log = math.log(speedup)
            on = Measured(device, backend, processor)
            yield TableCell(on, configuration, baseline, log, sessions, sure)


def _period_cells(
    filters: SpeedupFilters, front: str | None, which: Mapping[str, bool]
) -> Iterable[TableCell]:
    """Cells from the sessions of a period. Five queries."""
    cohorts = front_cohorts(front)
    columns = cohorts.values_list("pk", "device_id", "backend", "processor", "processor_class")
    cohort_of = {key: (device, backend, processor, kind) for key, device, backend, processor, kind in columns}
    devices = read_devices(device for device, *_ in cohort_of.values())
    names = dict(Configuration.objects.filter(front__slug=front, **which).values_list("pk", "name"))
    rows = SessionSummary.objects.filter(
        configuration__in=names,
        cohort__in=cohorts.values("pk"),
        **period_bounds(filters.since, filters.until),
    )
    for key, figure in figures(rows.filter(state=State.VALID)).items():
        device_key, backend, processor, kind = cohort_of[key.cohort]
        device, sessions = devices[device_key], figure.model.sessions
        if sessions >= filters.min_sessions and matches(
            filters, device, vendor(processor, device.gpu, kind), backend
        ):
            configuration, baseline = names[key.configuration], names[key.baseline]
            sure = is_confirmed(figure.witnesses)
            log = math.log(figure.model.speedup.value)
            on = Measured(device, backend, processor)
            yield TableCell(on, configuration, baseline, log, sessions, sure)


def _choose_rows(cells: Iterable[TableCell], least: int) -> dict[str, _Row]:
    """One row per device with at least `least` configurations, by slug, in order of slugs."""
    rows: dict[tuple[str, str, str], _Row] = {}
    for on, configuration, baseline, log, sessions, _ in cells:
        key = (on.device.slug, on.backend, on.processor)
        row = rows.get(key)
        if row is None:
            row = rows[key] = _Row(on, {baseline: 0.0})
        row.logs[configuration] = log
        row.sessions = max(row.sessions, sessions)
    chosen: dict[str, _Row] = {}
    for (slug, _, _), row in sorted(rows.items()):
        best = chosen.get(slug)
        if len(row.logs) >= least and (
            best is None or (len(row.logs), row.sessions) > (len(best.logs), best.sessions)
        ):
            chosen[slug] = row
    return chosen
