"""A front's configurations on every device that measured them, as one table: what transfer is read from."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowd.devices import revision
from crowd.devices.naming.vendors import vendor
from crowd.fronts.models import Configuration
from crowd.results.figures.cohorts import figures
from crowd.results.models import DeviceSpeedup, SessionSummary, State
from crowd.results.reading.figures import devices_of, is_confirmed, simulated_only
from crowd.results.reading.queries.filters import ALL, SpeedupFilters
from crowd.results.reading.rows import Device
from crowd.results.reading.speedups import between, cohorts_of, matches, measured_front
from crowd.results.reading.versioned_cache import VersionedCache


class Cell(NamedTuple):
    """One valid figure: the logarithm of a configuration's speedup over the baseline on a device."""

    device: Device
    backend: str
    processor: str
    configuration: str
    baseline: str
    log_speedup: float
    sessions: int
    confirmed: bool


@dataclass(frozen=True)
class Table:
    """Logarithms of speedup over the default, (devices, configurations): NaN where there is no confirmed
    figure, 0 in the default's column. One row a device: that of the processor with the most configurations,
    then sessions. `unconfirmed`: how many other devices have enough figures that are valid but not confirmed.
    """

    front: str | None
    devices: tuple[Device, ...]  # in the order of their slugs
    backends: tuple[str, ...]
    processors: tuple[str, ...]
    sessions: tuple[int, ...]  # of the configuration with the most
    configurations: tuple[str, ...]
    log_speedups: NDArray[np.float64]
    unconfirmed: int


# Of 2,000 devices and twenty configurations one takes a megabyte.
_cache: VersionedCache[Table] = VersionedCache(8)


def table(filters: SpeedupFilters, least: int, probes: bool = True) -> Table:
    """The confirmed figures of every configuration under FILTERS (whatever configuration they name), of
    devices with at least LEAST configurations, the default among them. The front's PROBES count unless that
    is False. Nine queries at most; four at most where nothing changed since this process answered the same.

    What a period's figures are made of changes together with stored figures, or waits to be worked into them.
    """
    front = filters.front or measured_front(filters.application, filters.simulated)
    filters = replace(filters, front=front or "", configuration=ALL, suspect=False)
    return _cache.get(
        revision.current, (filters.query(), least, probes), lambda: _table(filters, front, least, probes)
    )


def _table(filters: SpeedupFilters, front: str | None, least: int, probes: bool) -> Table:
    read = _of_period if filters.period else _stored
    cells = list(read(filters, front, {} if probes else {"probe": False}))
    chosen = _chosen((cell for cell in cells if cell.confirmed), least)
    unconfirmed = _chosen(cells, least).keys() - chosen.keys()
    names = sorted({name for row in chosen.values() for name in row.logs})
    columns = {name: column for column, name in enumerate(names)}
    values = np.full((len(chosen), len(names)), np.nan)
    for place, row in enumerate(chosen.values()):
        for name, log in row.logs.items():
            values[place, columns[name]] = log
    # Many requests share it.
    values.flags.writeable = False
    rows = list(chosen.values())
    return Table(
        front=front,
        devices=tuple(row.device for row in rows),
        backends=tuple(row.backend for row in rows),
        processors=tuple(row.processor for row in rows),
        sessions=tuple(row.sessions for row in rows),
        configurations=tuple(names),
        log_speedups=values,
        unconfirmed=len(unconfirmed),
    )


@dataclass
class _Row:
    device: Device
    backend: str
    processor: str
    logs: dict[str, float]
    sessions: int = 0


def _stored(filters: SpeedupFilters, front: str | None, which: Mapping[str, bool]) -> Iterable[Cell]:
    """Of WHICH configurations. Bare columns: a front has twenty, and a crowd thousands of devices."""
    rows = DeviceSpeedup.objects.filter(
        simulated_only(filters.simulated),
        front__slug=front,
        state=State.VALID,
        sessions__gte=filters.min_sessions,
        **{f"configuration__{name}": value for name, value in which.items()},
    ).order_by()
    found = list(
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
    devices = devices_of(row[0] for row in found)
    for key, backend, processor, kind, configuration, baseline, speedup, sessions, own, chip in found:
        device = devices[key]
        if matches(filters, device, vendor(processor, device.gpu, kind), backend):
            sure = is_confirmed(device, own, chip)
            log = math.log(speedup)
            yield Cell(device, backend, processor, configuration, baseline, log, sessions, sure)


def _of_period(filters: SpeedupFilters, front: str | None, which: Mapping[str, bool]) -> Iterable[Cell]:
    """The same from the sessions of a period. Five queries."""
    cohorts = cohorts_of(filters, front)
    columns = cohorts.values_list("pk", "device_id", "backend", "processor", "processor_class")
    found = {key: (device, backend, processor, kind) for key, device, backend, processor, kind in columns}
    devices = devices_of(device for device, *_ in found.values())
    names = dict(Configuration.objects.filter(front__slug=front, **which).values_list("pk", "name"))
    rows = SessionSummary.objects.filter(
        configuration__in=names, cohort__in=cohorts.values("pk"), **between(filters.since, filters.until)
    )
    for key, figure in figures(rows.filter(state=State.VALID)).items():
        device_key, backend, processor, kind = found[key.cohort]
        device, sessions = devices[device_key], figure.model.sessions
        if sessions >= filters.min_sessions and matches(
            filters, device, vendor(processor, device.gpu, kind), backend
        ):
            configuration, baseline = names[key.configuration], names[key.baseline]
            sure = is_confirmed(device, figure.witnesses)
            log = math.log(figure.model.speedup.value)
            yield Cell(device, backend, processor, configuration, baseline, log, sessions, sure)


def _chosen(cells: Iterable[Cell], least: int) -> dict[str, _Row]:
    """One row a device with enough configurations, by its slug and in the order of slugs."""
    rows: dict[tuple[str, str, str], _Row] = {}
    for device, backend, processor, configuration, baseline, log, sessions, _ in cells:
        key = (device.slug, backend, processor)
        row = rows.get(key)
        if row is None:
            row = rows[key] = _Row(device, backend, processor, {baseline: 0.0})
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
