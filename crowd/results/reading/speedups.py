"""The crowd's bars, under the filters of every page."""

from collections.abc import Iterable
from datetime import UTC, date, datetime, time, timedelta
from typing import Any, Protocol

from django.db.models import QuerySet

from crowd.devices import revision
from crowd.fronts.models import FrontVersion
from crowd.results.figures import cohorts as figures_of
from crowd.results.figures.confirmation import confirmed
from crowd.results.models import Cohort, DeviceSpeedup, Outcome, SessionSummary, State
from crowd.results.reading.crowd import Speedups
from crowd.results.reading.figures import devices_of, figures, hour, is_confirmed, simulated_only
from crowd.results.reading.queries.filters import ALL, SpeedupFilters, whole
from crowd.results.reading.rows import Attempt, Device, Speedup
from crowd.results.reading.versioned_cache import VersionedCache

# A crowd of 2,000 devices takes 3 MB.
_speedups_cache: VersionedCache[Speedups] = VersionedCache(8)
_front_cache: VersionedCache[str | None] = VersionedCache(8)


def measured_front(application: str, simulated: bool = False) -> str | None:
    """Slug of the newest published front with a confirmed figure, of people or of SIMULATED devices; else of
    the newest that was measured at all, else of the newest. Two queries; more after a change.
    """
    fronts = FrontVersion.objects.filter(application=application, state=FrontVersion.State.PUBLISHED)
    published = dict(fronts.values_list("slug", "pk"))
    key = (application, simulated, tuple(published))
    return _front_cache.get(revision.current, key, lambda: _measured_front(published, simulated))


def _measured_front(published: dict[str, int], simulated: bool) -> str | None:
    """PUBLISHED: keys of fronts by their slugs, newest first."""
    measured = DeviceSpeedup.objects.filter(simulated_only(simulated), front__in=published.values())
    counting = measured if simulated else measured.filter(confirmed(), state=State.VALID)
    for figured in (counting, measured):
        keys = set(figured.order_by().values_list("front", flat=True).distinct())
        for slug, key in published.items():
            if key in keys:
                return slug
    return next(iter(published), None)


def speedups(filters: SpeedupFilters) -> Speedups:
    """Bars and headline for FILTERS, fastest first. Ten queries at most, whatever the number of devices; four
    at most where nothing changed since this process answered the same.

    What a period's figures are made of changes together with stored figures, or waits to be worked into them.
    """
    front = filters.front or measured_front(filters.application, filters.simulated)
    return _speedups_cache.get(revision.current, (filters, front), lambda: _speedups(filters, front))


def _speedups(filters: SpeedupFilters, front: str | None) -> Speedups:
    found = _of_period(filters, front) if filters.period else _stored(filters, front)
    rows = [
        row
        for row in found
        if matches(filters, row.device, row.vendor, row.backend) and (filters.suspect or not row.suspect)
    ]
    ordered = tuple(sorted(rows, key=lambda row: (-row.speedup, row.device.slug, row.configuration)))
    return Speedups(filters, front, ordered, tuple(_attempts(filters, front)))


class DeviceFilters(Protocol):
    """The filters that a device and its chip decide."""

    @property
    def device(self) -> str: ...
    @property
    def vendor(self) -> str: ...
    @property
    def backend(self) -> str: ...
    @property
    def soc(self) -> str: ...
    @property
    def gpu(self) -> str: ...
    @property
    def os(self) -> str: ...


def matches(filters: DeviceFilters, device: Device, vendor: str, backend: str) -> bool:
    """Whether FILTERS ask for what DEVICE measured with BACKEND on a chip of VENDOR.

    They see what the public sees: a masked model is found by its chip alone.
    """
    called = f"{device.manufacturer} {device.name}".casefold()
    return (
        filters.vendor in ("", vendor)
        and filters.backend in ("", backend)
        and all(word in called for word in filters.device.casefold().split())
        and all(_matches(getattr(filters, part), getattr(device, part)) for part in ("soc", "gpu", "os"))
    )


def _matches(asked: str, text: str) -> bool:
    exact = whole(asked)
    return asked.casefold() in text.casefold() if exact is None else exact == text


def _stored(filters: SpeedupFilters, front: str | None) -> list[Speedup]:
    rows = DeviceSpeedup.objects.filter(simulated_only(filters.simulated), front__slug=front)
    if filters.min_sessions > 1:
        rows = rows.filter(sessions__gte=filters.min_sessions)
    if filters.configuration != ALL:
        rows = rows.filter(configuration__name=filters.configuration)
    return figures(rows)


def cohorts_of(filters: SpeedupFilters, front: str | None) -> QuerySet[Cohort]:
    """The cohorts of FRONT, of simulated devices or of those that people have."""
    return Cohort.objects.filter(simulated_only(filters.simulated), front__slug=front)


def _of_period(filters: SpeedupFilters, front: str | None) -> list[Speedup]:
    """The same figures from the sessions of a period alone, which no stored row holds. Six queries."""
    cohorts = cohorts_of(filters, front)
    found = {cohort.pk: cohort for cohort in cohorts}
    devices = devices_of(cohort.device_id for cohort in found.values())
    names = _names(front)
    asked = [key for key, name in names.items() if filters.configuration in (ALL, name)]
    rows = SessionSummary.objects.filter(
        configuration__in=asked, cohort__in=cohorts.values("pk"), **between(filters.since, filters.until)
    )
    return [
        Speedup(
            device=devices[found[key.cohort].device_id],
            front=front or "",
            configuration=names[key.configuration],
            baseline=names[key.baseline],
            backend=found[key.cohort].backend,
            processor=found[key.cohort].processor,
            processor_class=found[key.cohort].processor_class,
            **{name: value for name, value in figure.numbers.items() if name != "witnesses"},
            last_session_at=hour(figure.last_session_at),
            suspect=figure.state == State.SUSPECT,
            confirmed=is_confirmed(devices[found[key.cohort].device_id], figure.witnesses),
        )
        for key, figure in figures_of.figures(rows).items()
        if figure.model.sessions >= filters.min_sessions
    ]


def _attempts(filters: SpeedupFilters, front: str | None) -> Iterable[Attempt]:
    """How each configuration fared under FILTERS. Three queries, four for a period."""
    cohorts = cohorts_of(filters, front)
    counts: Iterable[tuple[Any, ...]]
    if filters.period:
        rows = SessionSummary.objects.filter(
            cohort__in=cohorts.values("pk"), **between(filters.since, filters.until)
        )
        counts = [(*key, *found) for key, found in figures_of.outcomes(rows).items()]
    else:
        counts = Outcome.objects.filter(cohort__in=cohorts.values("pk")).values_list(
            "cohort_id", "configuration_id", *figures_of.OutcomeCounts._fields
        )
    columns = cohorts.values_list("pk", "device_id", "backend", "processor", "processor_class")
    places = {key: (device, backend, processor, kind) for key, device, backend, processor, kind in columns}
    devices = devices_of(device for device, *_ in places.values())
    names = _names(front)
    for cohort, configuration, *found in counts:
        device, backend, processor, kind = places[cohort]
        row = Attempt(devices[device], names[configuration], backend, processor, kind, *found)
        if matches(filters, row.device, row.vendor, row.backend) and row.sessions >= filters.min_sessions:
            yield row


def _names(front: str | None) -> dict[int, str]:
    """The names of FRONT's configurations by their keys."""
    version = FrontVersion.objects.filter(slug=front).first()
    return {} if version is None else dict(version.configurations.values_list("pk", "name"))


def between(since: date | None, until: date | None) -> dict[str, datetime]:
    """Sessions from the beginning of SINCE to the end of UNTIL (UTC)."""
    bounds = {}
    if since:
        bounds["started_at__gte"] = datetime.combine(since, time.min, UTC)
    if until and until < date.max:
        bounds["started_at__lt"] = datetime.combine(until + timedelta(days=1), time.min, UTC)
    return bounds
