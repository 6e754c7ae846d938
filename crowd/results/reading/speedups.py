"""Filtered speedups, with the headline."""

from collections.abc import Iterable, Mapping
from datetime import UTC, date, datetime, time, timedelta
from typing import Any

from django.conf import settings
from django.db.models import CharField, QuerySet

from crowd.database.prepared import CompiledQuery, Placeholder
from crowd.devices import revision
from crowd.devices.naming.chips import vendor
from crowd.fronts import selectors
from crowd.fronts.models import Configuration, FrontVersion
from crowd.records.device import Device
from crowd.records.speedup import Speedup
from crowd.results.figures import cohorts as figures_of
from crowd.results.figures.confirmation import confirmed
from crowd.results.figures.plausible import possible_range
from crowd.results.models import Cohort, DeviceSpeedup, Outcome, SessionSummary, State
from crowd.results.public_rows import figure_row, read_devices, speedup_rows
from crowd.results.reading.aggregates import Speedups
from crowd.results.reading.queries.filters import ALL, Filters, SpeedupFilters, exact_text
from crowd.results.reading.rows import CohortOutcome
from crowd.results.reading.versioned_cache import VersionedCache
from crowd.results.validity.plausibility import Bounds

# A crowd of 2,000 devices takes 3 MB.
_speedups_cache: VersionedCache[Speedups] = VersionedCache(8)
_front_cache: VersionedCache[str | None] = VersionedCache(8)


def measured_front(application: str) -> str | None:
    """Slug of the newest published front with a confirmed figure.

    Without one, the newest measured front, else the newest. Two queries; more after a change.
    """
    published = dict(_published.rows(application=application))
    key = (application, tuple(published))
    return _front_cache.get(revision.current, key, lambda: _measured_front(published))


_published = CompiledQuery(
    lambda: FrontVersion.objects.filter(
        application=Placeholder("application", CharField()), state=FrontVersion.State.PUBLISHED
    ).values_list("slug", "pk")
)


def _measured_front(published: dict[str, int]) -> str | None:
    """`published`: the keys of fronts by slug, newest first."""
    measured = DeviceSpeedup.objects.filter(front__in=published.values())
    counting = measured.filter(confirmed(), state=State.VALID)
    for figured in (counting, measured):
        keys = set(figured.order_by().values_list("front", flat=True).distinct())
        for slug, key in published.items():
            if key in keys:
                return slug
    return next(iter(published), None)


def speedups(filters: SpeedupFilters) -> Speedups:
    """The figures that match `filters`, fastest first.

    At most ten queries for any number of devices; at most four if nothing changed since the last call of this
    process. Figures of a period are cached, too: their summaries change only together with stored figures.
    """
    front = filters.front or measured_front(filters.application)
    if not filters.apply_here:
        return Speedups(filters, front, (), ())
    return _speedups_cache.get(revision.current, (filters, front), lambda: _speedups(filters, front))


def _speedups(filters: SpeedupFilters, front: str | None) -> Speedups:
    columns = ("device", "backend", "processor", "processor_class")
    cohorts = {cohort.pk: cohort for cohort in front_cohorts(front).only(*columns)}
    devices = read_devices(cohort.device_id for cohort in cohorts.values())
    if filters.period:
        figures = _period_figures(filters, front, cohorts, devices)
    else:
        figures = _stored_figures(filters, front, devices)
    rows = [
        row
        for row in figures
        if matches(filters, row.device, row.vendor, row.backend) and (filters.suspect or not row.suspect)
    ]
    ordered = tuple(sorted(rows, key=lambda row: (-row.speedup, row.device.slug, row.configuration)))
    counted = tuple(_outcomes(filters, front, cohorts, devices))
    return Speedups(filters, front, ordered, counted, _possible_ranges(front, ordered))


def _possible_ranges(front: str | None, rows: Iterable[Speedup]) -> dict[str, Bounds]:
    """The possible log ratios of each configuration of `front` in `rows`.

    Two queries; none without a quorum.
    """
    names = {row.configuration for row in rows}
    full_front = selectors.front(front) if front and names and settings.FRONTRUNNER_QUORUM > 1 else None
    points = (*full_front.points, *full_front.probes) if full_front else ()
    return {
        point.name: possible_range(full_front, point)
        for point in points
        if full_front and point.name in names
    }


def matches(filters: Filters, device: Device, vendor: str, backend: str) -> bool:
    """Whether `device`, measured with `backend` on a chip of `vendor`, matches `filters`.

    Filters only use public data: a masked model is found by its chip only.
    """
    called = f"{device.manufacturer} {device.name}".casefold()
    return (
        filters.vendor in ("", vendor)
        and filters.backend in ("", backend)
        and all(word in called for word in filters.device.casefold().split())
        and all(_matches(getattr(filters, part), getattr(device, part)) for part in ("soc", "gpu", "os"))
    )


def _matches(asked: str, text: str) -> bool:
    exact = exact_text(asked)
    return asked.casefold() in text.casefold() if exact is None else exact == text


def _stored_figures(
    filters: SpeedupFilters, front: str | None, devices: Mapping[int, Device]
) -> list[Speedup]:
    rows = DeviceSpeedup.objects.filter(front__slug=front)
    if filters.min_sessions > 1:
        rows = rows.filter(sessions__gte=filters.min_sessions)
    if filters.configuration != ALL:
        rows = rows.filter(configuration__name=filters.configuration)
    return speedup_rows(rows, devices)


def front_cohorts(front: str | None) -> QuerySet[Cohort]:
    """The cohorts of `front`."""
    return Cohort.objects.filter(front__slug=front)


def _period_figures(
    filters: SpeedupFilters, front: str | None, cohorts: Mapping[int, Cohort], devices: Mapping[int, Device]
) -> list[Speedup]:
    """The figures from the sessions of a period, which are not stored. Two queries."""
    names = _configuration_names(front)
    asked = [key for key, name in names.items() if filters.configuration in (ALL, name)]
    rows = SessionSummary.objects.filter(
        configuration__in=asked,
        cohort__in=front_cohorts(front).values("pk"),
        **period_bounds(filters.since, filters.until),
    )
    figures = []
    for key, figure in figures_of.figures(rows).items():
        cohort = cohorts.get(key.cohort)
        if cohort is None or figure.model.sessions < filters.min_sessions:
            continue
        configuration, baseline = ((front or "", names[each]) for each in (key.configuration, key.baseline))
        figures.append(figure_row(figure, cohort, devices[cohort.device_id], configuration, baseline))
    return figures


def _outcomes(
    filters: SpeedupFilters, front: str | None, cohorts: Mapping[int, Cohort], devices: Mapping[int, Device]
) -> Iterable[CohortOutcome]:
    """The outcomes of each configuration under `filters`. Two queries."""
    keys = front_cohorts(front).values("pk")
    counts: Iterable[tuple[Any, ...]]
    if filters.period:
        rows = SessionSummary.objects.filter(cohort__in=keys, **period_bounds(filters.since, filters.until))
        counts = [(*key, *outcome) for key, outcome in figures_of.outcomes(rows).items()]
    else:
        counts = Outcome.objects.filter(cohort__in=keys).values_list(
            "cohort_id", "configuration_id", *figures_of.OutcomeCounts._fields
        )
    names = _configuration_names(front)
    for key, configuration, *numbers in counts:
        cohort = cohorts.get(key)
        if cohort is None:  # created after COHORTS were read
            continue
        device = devices[cohort.device_id]
        chip = vendor(cohort.processor, device.gpu, cohort.processor_class)
        outcome = figures_of.OutcomeCounts(*numbers)
        row = CohortOutcome(device, names[configuration], cohort.backend, cohort.processor, chip, outcome)
        if matches(filters, device, chip, row.backend) and outcome.sessions >= filters.min_sessions:
            yield row


def _configuration_names(front: str | None) -> dict[int, str]:
    """The names of the configurations of `front` by their keys."""
    return dict(Configuration.objects.filter(front__slug=front).values_list("pk", "name"))


def period_bounds(since: date | None, until: date | None) -> dict[str, datetime]:
    """Lookups for sessions from the start of `since` to the end of `until` (UTC)."""
    bounds = {}
    if since:
        bounds["started_at__gte"] = datetime.combine(since, time.min, UTC)
    if until and until < date.max:
        bounds["started_at__lt"] = datetime.combine(until + timedelta(days=1), time.min, UTC)
    return bounds
