"""Measured devices: the list, and one device with its configurations and sessions."""

from collections.abc import Iterable, Sequence
from typing import Any

from django.db.models import CharField, Exists, OuterRef, QuerySet

from crowd.database.prepared import CompiledQuery, Placeholder
from crowd.devices import revision
from crowd.devices.disclosure import find, public_device
from crowd.fronts.selectors import DEFAULT_APPLICATION
from crowd.records.device import Device
from crowd.records.measured_device import DeviceRow
from crowd.records.session import SessionRow
from crowd.records.speedup import Speedup
from crowd.results.models import DeviceActivity, DeviceSpeedup, MeasurementSession, State
from crowd.results.public_rows import DEVICE_COLUMNS, all_devices, devices_of, round_to_hour, speedup_rows
from crowd.results.reading.backends import leading_figures
from crowd.results.reading.queries.filters import SpeedupFilters
from crowd.results.reading.rows import DeviceDetail
from crowd.results.reading.sessions import LISTED_SESSIONS, session_detail, session_rows
from crowd.results.reading.speedups import speedups
from crowd.results.reading.versioned_cache import VersionedCache
from wire.front import BEST

ACTIVITY_COLUMNS = (*DEVICE_COLUMNS, "sessions", "installations", "last_session_at")
# Devices by their keys.
_devices_cache: VersionedCache[dict[int, Device]] = VersionedCache(2)


def devices(application: str = DEFAULT_APPLICATION) -> tuple[DeviceRow, ...]:
    """The devices with a summarised session, fastest on `application` first.

    Devices without a figure for `application` come last. Sessions and installations are counted over all
    applications. At most thirteen queries for any number of devices.
    """
    crowd = speedups(SpeedupFilters(application=application))
    best = leading_figures(crowd.rows)
    models = public_devices()
    counts = DeviceActivity.objects.values_list("device_id", "sessions", "installations", "last_session_at")
    rows = (
        DeviceRow(
            device=device,
            sessions=sessions,
            installations=installations,
            last_session_at=round_to_hour(last),
            speedup=best.get(device.slug),
        )
        for key, sessions, installations, last in counts
        if (device := models.get(key)) is not None
    )
    return tuple(
        sorted(rows, key=lambda row: (-(row.speedup.speedup if row.speedup else 0.0), row.device.slug))
    )


def public_devices() -> dict[int, Device]:
    """All models as the public sees them, by key. Two queries; one if nothing changed.

    A model without a summarised session may be missing.
    """
    return _devices_cache.get(revision.current, None, all_devices)


def devices_without_figure(application: str, front: str | None) -> tuple[DeviceRow, ...]:
    """Devices with a summarised session of `application` but no figure of `best` on `front`, by slug.

    Counts are as in `devices`. One query for any number of devices.
    """
    found = _without_figure.rows(application=application, front=front)
    rows = [dict(zip(ACTIVITY_COLUMNS, row, strict=True)) for row in found]
    device_of = devices_of(rows)
    listed = (
        DeviceRow(
            device=device_of[row["device__pk"]],
            sessions=row["sessions"],
            installations=row["installations"],
            last_session_at=round_to_hour(row["last_session_at"]),
            speedup=None,
        )
        for row in rows
    )
    return tuple(sorted(listed, key=lambda row: row.device.slug))


def _activities_without_figure() -> "QuerySet[DeviceActivity, tuple[Any, ...]]":
    figured = DeviceSpeedup.objects.filter(
        front__slug=Placeholder("front", CharField()), configuration__name=BEST
    )
    measured = MeasurementSession.objects.filter(
        device=OuterRef("device"), front__application=Placeholder("application", CharField())
    )
    rows = DeviceActivity.objects.filter(Exists(measured)).exclude(device__in=figured.values("device"))
    return rows.values_list(*ACTIVITY_COLUMNS)


_without_figure = CompiledQuery(_activities_without_figure)


def device(slug: str, application: str | None = None) -> DeviceDetail | None:
    """The device `slug` with its figures (newest front first) and newest sessions; of `application`, if
    given.

    Sessions and installations are counted over all applications. The latest session is the newest that counts
    for the figure of best, else the newest. None for an unknown `slug`, and for the name of a masked model.
    """
    model = find(slug)
    if model is None:
        return None
    of_one = {} if application is None else {"front__application": application}
    sessions = MeasurementSession.objects.filter(device=model, **of_one)
    listed = session_rows(sessions[:LISTED_SESSIONS])
    if not listed:
        return None
    rows = DeviceSpeedup.objects.filter(device=model, **of_one).order_by("-front__published_at", "-speedup")
    public = public_device(model)
    speedups_of = tuple(speedup_rows(rows, {model.pk: public}))
    activity = DeviceActivity.objects.filter(device=model).first()
    return DeviceDetail(
        device=public,
        speedups=speedups_of,
        sessions=listed,
        # The sessions of a device are not counted before its first summary.
        session_count=activity.sessions if activity else len(listed),
        installations=activity.installations if activity else 0,
        latest=session_detail(_leading_session(sessions, listed, speedups_of)),
    )


def _leading_session(
    sessions: QuerySet[MeasurementSession], listed: Sequence[SessionRow], rows: Iterable[Speedup]
) -> SessionRow:
    """The newest session that counts for the figure of `best` on the front of the newest session.

    If there is none: the newest session with the backend of that figure, else the newest session. `sessions`
    are all of the device, `listed` the newest ones.
    """
    newest = listed[0]
    of_front = [row for row in rows if (row.front, row.configuration) == (newest.front, BEST)]
    backends = {row.backend for row in leading_figures(of_front).values()}
    leads = [row for row in listed if row.front == newest.front and row.backend in backends]
    for row in leads:
        summary = row.speedup(BEST)
        if summary is not None and summary.state == State.VALID:
            return row
    if leads or not backends:
        return leads[0] if leads else newest
    others = session_rows(sessions.filter(front__slug=newest.front, backend__in=backends)[:1])
    return others[0] if others else newest
