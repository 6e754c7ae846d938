"""A front's configurations on every device that measured them, as one table: what transfer is read from."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from crowd.devices.models import DeviceModel
from crowd.devices.vendors import vendor
from crowd.fronts.models import Configuration
from crowd.results.figures import summaries
from crowd.results.models import Cohort, DeviceSpeedup, SessionSummary, State
from crowd.results.reading.figures import device_of, version
from crowd.results.reading.filters import ALL, SpeedupFilters
from crowd.results.reading.rows import Device
from crowd.results.reading.speedups import between, measured_front, of_devices
from crowd.results.reading.versioned_cache import VersionedCache

# device's slug, backend, processor, configuration, baseline, logarithm of the speedup, sessions
Cell = tuple[str, str, str, str, str, float, int]


@dataclass(frozen=True)
class Table:
    """Logarithms of speedup over the default, (devices, configurations): NaN where there is no valid figure,
    0 in the default's column. One row a device: that of the processor with the most configurations, then
    sessions.
    """

    front: str | None
    slugs: tuple[str, ...]  # of the devices, in order
    backends: tuple[str, ...]
    processors: tuple[str, ...]
    sessions: tuple[int, ...]  # of the configuration with the most
    configurations: tuple[str, ...]
    log_speedups: NDArray[np.float64]


# Of 2,000 devices and twenty configurations one takes a megabyte.
_kept: VersionedCache[Table] = VersionedCache(8)


def table(filters: SpeedupFilters, least: int) -> Table:
    """The valid figures of every configuration under FILTERS (whatever configuration they name), of devices
    with at least LEAST configurations, the default among them. Nine queries at most; four at most where
    nothing changed since this process answered the same.

    What a period's figures are made of changes together with stored figures, or waits to be worked into them.
    """
    front = filters.front or measured_front(filters.application, filters.simulated)
    filters = replace(filters, front=front or "", configuration=ALL, suspect=False)
    return _kept.get(version, (filters.query(), least), lambda: _table(filters, front, least))


def _table(filters: SpeedupFilters, front: str | None, least: int) -> Table:
    cells = _of_period(filters, front) if filters.period else _stored(filters, front)
    chosen = _chosen(cells, least)
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
        slugs=tuple(chosen),
        backends=tuple(row.backend for row in rows),
        processors=tuple(row.processor for row in rows),
        sessions=tuple(row.sessions for row in rows),
        configurations=tuple(names),
        log_speedups=values,
    )


def named(slugs: Iterable[str]) -> dict[str, Device]:
    """The devices called SLUGS. One query for each thousand."""
    return {
        slug: device_of(model)
        for slug, model in DeviceModel.objects.in_bulk(list(slugs), field_name="slug").items()
    }


@dataclass
class _Row:
    backend: str
    processor: str
    logs: dict[str, float]
    sessions: int = 0


def _stored(filters: SpeedupFilters, front: str | None) -> Iterable[Cell]:
    """Bare columns: a front has twenty configurations, and a crowd thousands of devices."""
    rows = DeviceSpeedup.objects.filter(
        of_devices(filters), front__slug=front, state=State.VALID, sessions__gte=filters.min_sessions
    ).order_by()
    found = rows.values_list(
        "device__slug", "backend", "processor", "configuration__name", "baseline__name", "speedup",
        "sessions", "device__gpu",
    )  # fmt: skip
    return (
        (*row[:5], math.log(row[5]), row[6])
        for row in found
        if filters.vendor in ("", vendor(row[2], row[7]))
    )


def _of_period(filters: SpeedupFilters, front: str | None) -> Iterable[Cell]:
    """The same from the sessions of a period. Three queries."""
    cohorts = Cohort.objects.filter(of_devices(filters), front__slug=front)
    found = cohorts.values_list("pk", "device__slug", "backend", "processor", "device__gpu")
    places = {key: place for key, *place, gpu in found if filters.vendor in ("", vendor(place[2], gpu))}
    names = dict(Configuration.objects.filter(front__slug=front).values_list("pk", "name"))
    rows = SessionSummary.objects.filter(
        configuration__in=names, cohort__in=cohorts.values("pk"), **between(filters.since, filters.until)
    )
    for key, (log, sessions) in summaries.valid_speedups(rows).items():
        if key.cohort in places and sessions >= filters.min_sessions:
            slug, backend, processor = places[key.cohort]
            yield slug, backend, processor, names[key.configuration], names[key.baseline], log, sessions


def _chosen(cells: Iterable[Cell], least: int) -> dict[str, _Row]:
    """One row a device with enough configurations, by its slug and in the order of slugs."""
    rows: dict[tuple[str, str, str], _Row] = {}
    for slug, backend, processor, configuration, baseline, log, sessions in cells:
        key = (slug, backend, processor)
        row = rows.get(key)
        if row is None:
            row = rows[key] = _Row(backend, processor, {baseline: 0.0})
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
