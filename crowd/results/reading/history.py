"""What a new driver or a new version of the system did to a device's speedup."""

from collections import defaultdict
from collections.abc import Iterable, Mapping
from datetime import datetime
from typing import Any

from django.db.models import Avg, Count, Max, Min
from django.db.models.fields.json import KT

from crowd.devices.models import DeviceDescription, DeviceModel
from crowd.fronts.selectors import BEST
from crowd.results.figures import statistics
from crowd.results.models import Cohort, DeviceSpeedup, SessionSummary, State
from crowd.results.reading.figures import hour
from crowd.results.reading.rows import History, Release


def history(slug: str, configuration: str = BEST, application: str | None = None) -> History | None:
    """CONFIGURATION on the device SLUG by driver and version of the system, of the newest front (of
    APPLICATION where one is given) and, of several processors, of the one with the most sessions. None
    where it has no valid figure. Three queries.

    Of a group of rare models the system's version is left out, as all that they say of themselves.
    """
    of_one = {} if application is None else {"front__application": application}
    figure = (
        DeviceSpeedup.objects.filter(device__slug=slug, configuration__name=configuration, state=State.VALID)
        .filter(**of_one)
        .select_related("device", "front")
        .defer("front__provenance", "front__sequence", "front__protocol")
        .order_by("-front__published_at", "-sessions", "processor")
        .first()
    )
    if figure is None:
        return None
    cohorts = Cohort.objects.filter(
        device=figure.device_id, front=figure.front_id, backend=figure.backend, processor=figure.processor
    )
    rows = list(
        SessionSummary.objects.filter(
            cohort__in=cohorts, configuration=figure.configuration_id, state=State.VALID, counted=True
        )
        .order_by("installation_id", "session__description_id", "session__driver")
        .values("installation_id", "session__description_id", "session__driver")
        .annotate(mean=Avg("log_ratio"), count=Count("id"), first=Min("started_at"), last=Max("started_at"))
    )
    versions = _versions(figure.device, {row["session__description_id"] for row in rows})
    groups: dict[tuple[str, str], list[Mapping[str, Any]]] = defaultdict(list)
    for row in rows:
        groups[row["session__driver"], versions.get(row["session__description_id"], "")].append(row)
    releases = [_release(driver, version, members) for (driver, version), members in groups.items()]
    return History(
        front=figure.front.slug,
        configuration=configuration,
        backend=figure.backend,
        processor=figure.processor,
        releases=tuple(sorted(releases, key=lambda row: (row.first_at, row.driver, row.os_version))),
    )


def _versions(device: DeviceModel, descriptions: Iterable[int]) -> dict[int, str]:
    """The system's version by the description's key; none of a group."""
    if device.kind == DeviceModel.Kind.GROUP:
        return {}
    rows = DeviceDescription.objects.filter(pk__in=descriptions).values_list("pk", KT("raw__os_version"))
    return {key: version for key, version in rows if isinstance(version, str)}


def _release(driver: str, os_version: str, rows: Iterable[Mapping[str, Any]]) -> Release:
    """Of ROWS, an installation's sessions with one description each; installations weigh the same."""
    logs: dict[Any, float] = defaultdict(float)
    counts: dict[Any, int] = defaultdict(int)
    moments: list[datetime] = []
    for row in rows:
        logs[row["installation_id"]] += row["mean"] * row["count"]
        counts[row["installation_id"]] += row["count"]
        moments += [row["first"], row["last"]]
    speedup = statistics.model_speedup(
        [statistics.InstallationValue(logs[who] / counts[who], 0.0, counts[who]) for who in logs]
    ).speedup
    return Release(
        driver=driver,
        os_version=os_version,
        speedup=speedup.value,
        low=speedup.low,
        high=speedup.high,
        sessions=sum(counts.values()),
        installations=len(counts),
        first_at=hour(min(moments)),
        last_at=hour(max(moments)),
    )
