"""The crowd's bars, under the filters of every page."""

from datetime import UTC, date, datetime, time, timedelta
from functools import reduce
from operator import or_

from django.db.models import Q

from crowd.fronts.models import FrontVersion
from crowd.results.figures import summaries
from crowd.results.models import Cohort, DeviceSpeedup, SessionSummary, State
from crowd.results.reading.crowd import Speedups
from crowd.results.reading.figures import device_of, figures, hour, simulated_only, version
from crowd.results.reading.filters import ALL, SpeedupFilters, whole
from crowd.results.reading.rows import Speedup
from crowd.results.reading.versioned_cache import VersionedCache

CALLED = ("manufacturer", "name", "market_name")
# A crowd of 2,000 devices takes 3 MB.
_kept: VersionedCache[Speedups] = VersionedCache(8)


def measured_front(application: str, simulated: bool = False) -> str | None:
    """Slug of the newest published front that is measured, by people or by SIMULATED devices; the newest of
    all before anyone measured.
    """
    published = FrontVersion.objects.filter(application=application, state=FrontVersion.State.PUBLISHED)
    figured = DeviceSpeedup.objects.filter(simulated_only(simulated))
    measured = published.filter(pk__in=figured.values("front_id"))
    return measured.values_list("slug", flat=True).first() or published.values_list("slug", flat=True).first()


def speedups(filters: SpeedupFilters) -> Speedups:
    """Bars and headline for FILTERS, fastest first. Ten queries at most, whatever the number of devices; four
    at most where nothing changed since this process answered the same.

    What a period's figures are made of changes together with stored figures, or waits to be worked into them.
    """
    front = filters.front or measured_front(filters.application, filters.simulated)
    return _kept.get(version, (filters, front), lambda: _speedups(filters, front))


def _speedups(filters: SpeedupFilters, front: str | None) -> Speedups:
    found = _of_period(filters, front) if filters.period else _stored(filters, front)
    rows = [
        row for row in found if filters.vendor in ("", row.vendor) and (filters.suspect or not row.suspect)
    ]
    ordered = tuple(sorted(rows, key=lambda row: (-row.speedup, row.device.slug, row.configuration)))
    return Speedups(filters, front, ordered)


def _stored(filters: SpeedupFilters, front: str | None) -> list[Speedup]:
    rows = DeviceSpeedup.objects.filter(of_devices(filters), front__slug=front)
    if filters.min_sessions > 1:
        rows = rows.filter(sessions__gte=filters.min_sessions)
    if filters.configuration != ALL:
        rows = rows.filter(configuration__name=filters.configuration)
    return figures(rows)


def of_devices(filters: SpeedupFilters) -> Q:
    """Whose figures FILTERS ask for, of rows that carry a device and a backend."""
    texts = {"soc": filters.soc, "gpu": filters.gpu, "os": filters.os}
    asked = dict(_matching(f"device__{name}", text) for name, text in texts.items() if text)
    if filters.backend:
        asked["backend"] = filters.backend
    return simulated_only(filters.simulated) & Q(**asked) & _called(filters.device)


def _called(words: str) -> Q:
    """Devices whose maker or name holds each of WORDS."""
    found = Q()
    for word in dict.fromkeys(words.split()):
        places = (Q(**{f"device__{name}__icontains": word}) for name in CALLED)
        found &= reduce(or_, places)
    return found


def _matching(field: str, text: str) -> tuple[str, str]:
    """The look-up of TEXT in FIELD."""
    exact = whole(text)
    return (f"{field}__icontains", text) if exact is None else (field, exact)


def _of_period(filters: SpeedupFilters, front: str | None) -> list[Speedup]:
    """The same figures from the sessions of a period alone, which no stored row holds. Four queries."""
    cohorts = Cohort.objects.filter(of_devices(filters), front__slug=front)
    found = {cohort.pk: cohort for cohort in cohorts.select_related("device")}
    version = FrontVersion.objects.filter(slug=front).prefetch_related("configurations").first()
    called = {c.pk: c.name for c in version.configurations.all()} if version else {}
    asked = [key for key, name in called.items() if filters.configuration in (ALL, name)]
    rows = SessionSummary.objects.filter(
        configuration__in=asked, cohort__in=cohorts.values("pk"), **between(filters.since, filters.until)
    )
    return [
        Speedup(
            device=device_of(found[key.cohort].device),
            front=front or "",
            configuration=called[key.configuration],
            baseline=called[key.baseline],
            backend=found[key.cohort].backend,
            processor=found[key.cohort].processor,
            **figure.numbers,
            last_session_at=hour(figure.last_session_at),
            suspect=figure.state == State.SUSPECT,
        )
        for key, figure in summaries.figures(rows).items()
        if figure.model.sessions >= filters.min_sessions
    ]


def between(since: date | None, until: date | None) -> dict[str, datetime]:
    """Sessions from the beginning of SINCE to the end of UNTIL (UTC)."""
    bounds = {}
    if since:
        bounds["started_at__gte"] = datetime.combine(since, time.min, UTC)
    if until and until < date.max:
        bounds["started_at__lt"] = datetime.combine(until + timedelta(days=1), time.min, UTC)
    return bounds
