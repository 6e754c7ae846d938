"""How a device's speedup changed with drivers and versions of its operating system."""

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime
from typing import Any
from uuid import UUID

from django.db.models import Avg, Count, Max, Min
from django.db.models.fields.json import KT

from crowd.devices.disclosure import find, is_disclosed
from crowd.devices.models import DeviceDescription, DeviceModel
from crowd.results.figures import statistics
from crowd.results.figures.cohorts import cohort_key
from crowd.results.models import Cohort, DeviceSpeedup, SessionSummary, State
from crowd.results.public_rows import round_to_hour
from crowd.results.reading.public_texts import public_os_version
from crowd.results.reading.rows import History, Release
from wire.front import BEST


def history(slug: str, application: str | None = None) -> History | None:
    """The speedups of `best` on the device `slug` by driver and version of the operating system.

    From the newest front (of `application`, if given), and of several processors that with the most sessions.
    None without a valid figure. The version is left out for a masked model. Six queries.
    """
    of_one = {} if application is None else {"front__application": application}
    model = find(slug)
    if model is None:
        return None
    figure = (
        DeviceSpeedup.objects.filter(device=model, configuration__name=BEST, state=State.VALID)
        .filter(**of_one)
        .select_related("front")
        .defer("front__document", "front__sequence")
        .order_by("-front__published_at", "-sessions", "processor")
        .first()
    )
    if figure is None:
        return None
    cohorts = Cohort.objects.filter(**cohort_key(figure)._asdict())
    rows = list(
        SessionSummary.objects.filter(
            cohort__in=cohorts, configuration=figure.configuration_id, state=State.VALID, counted=True
        )
        .order_by("installation_id", "session__description_id", "session__driver")
        .values("installation_id", "installation__network", "session__description_id", "session__driver")
        .annotate(mean=Avg("log_ratio"), count=Count("id"), first=Min("started_at"), last=Max("started_at"))
    )
    versions = _versions(model, {row["session__description_id"] for row in rows})
    groups: dict[tuple[str, str], list[Mapping[str, Any]]] = defaultdict(list)
    for row in rows:
        groups[row["session__driver"], versions.get(row["session__description_id"], "")].append(row)
    releases = [_release(driver, version, members) for (driver, version), members in groups.items()]
    return History(
        front=figure.front.slug,
        configuration=BEST,
        backend=figure.backend,
        processor=figure.processor,
        releases=tuple(sorted(releases, key=lambda row: (row.first_at, row.driver, row.os_version))),
    )


def _versions(device: DeviceModel, descriptions: Iterable[int]) -> dict[int, str]:
    """The version of the operating system by the key of the description; empty for a masked device."""
    if not is_disclosed(device):
        return {}
    rows = DeviceDescription.objects.filter(pk__in=descriptions).values_list("pk", KT("raw__os_version"))
    return {key: public_os_version(version) for key, version in rows if isinstance(version, str)}


def _release(driver: str, os_version: str, rows: Sequence[Mapping[str, Any]]) -> Release:
    """The speedup over `rows`, each an installation's sessions with one description.

    Installations have equal weight, and those of one network count once.
    """
    networks = {row["installation_id"]: row["installation__network"] or None for row in rows}
    logs: dict[UUID, float] = defaultdict(float)
    counts: dict[UUID, int] = defaultdict(int)
    moments: list[datetime] = []
    for row in rows:
        logs[row["installation_id"]] += row["mean"] * row["count"]
        counts[row["installation_id"]] += row["count"]
        moments += [row["first"], row["last"]]
    model = statistics.model_speedup(
        [
            statistics.InstallationValue(logs[who] / counts[who], 0.0, counts[who], networks[who])
            for who in logs
        ]
    )
    return Release(
        driver=driver,
        os_version=os_version,
        speedup=model.speedup.value,
        low=model.speedup.low,
        high=model.speedup.high,
        sessions=model.sessions,
        installations=model.installations,
        first_at=round_to_hour(min(moments)),
        last_at=round_to_hour(max(moments)),
    )
