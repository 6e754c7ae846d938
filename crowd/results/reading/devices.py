"""Devices: all that somebody measured, and one with its configurations and sessions."""

from collections.abc import Iterable, Sequence

from django.db.models import Exists, OuterRef, QuerySet

from crowd.devices import revision
from crowd.devices.disclosure import COLUMNS, find
from crowd.devices.models import DeviceModel
from crowd.fronts.selectors import BEST, DEFAULT_APPLICATION
from crowd.results.models import DeviceActivity, DeviceSpeedup, MeasurementSession, State
from crowd.results.reading.backends import leading
from crowd.results.reading.figures import device_of, devices_of, figures, hour, simulated_only
from crowd.results.reading.queries.filters import SpeedupFilters
from crowd.results.reading.rows import Device, DeviceDetail, DeviceRow, Speedup
from crowd.results.reading.sessions import LISTED_SESSIONS, session_detail, session_row, session_rows
from crowd.results.reading.speedups import measured_front, speedups
from crowd.results.reading.versioned_cache import VersionedCache

# By their keys; of a few versions of the data.
_devices_cache: VersionedCache[dict[int, Device]] = VersionedCache(2)


def devices(simulated: bool = False, application: str = DEFAULT_APPLICATION) -> tuple[DeviceRow, ...]:
    """Every device with a summarised session, fastest on APPLICATION first, those without a figure of it
    last; of the SIMULATED ones, or of those that people measured. Sessions and installations are counted over
    all applications. Thirteen queries at most, whatever the number of devices.
    """
    crowd = speedups(SpeedupFilters(simulated=simulated, application=application))
    best = leading(crowd.rows)
    models = public_devices()
    counts = DeviceActivity.objects.values_list("device_id", "sessions", "installations", "last_session_at")
    rows = (
        DeviceRow(device, sessions, installations, hour(last), best.get(device.slug))
        for key, sessions, installations, last in counts
        if (device := models.get(key)) is not None and device.simulated == simulated
    )
    return tuple(
        sorted(rows, key=lambda row: (-(row.speedup.speedup if row.speedup else 0.0), row.device.slug))
    )


def public_devices() -> dict[int, Device]:
    """Every model as the public sees it, by its key. Two queries; one where nothing changed. A model that
    nobody's summarised session names yet may be missing.
    """
    return _devices_cache.get(revision.current, None, _devices)


def _devices() -> dict[int, Device]:
    return {model.pk: device_of(model) for model in DeviceModel.objects.only(*COLUMNS)}


def pending(simulated: bool = False, application: str = DEFAULT_APPLICATION) -> tuple[DeviceRow, ...]:
    """Devices with a summarised session of APPLICATION and no figure of `best` on its default front, by slug;
    of the SIMULATED ones, or of those that people measured; counted as `devices` does. Four queries at most,
    whatever the number of devices.
    """
    front = measured_front(application, simulated)
    figured = DeviceSpeedup.objects.filter(front__slug=front, configuration__name=BEST)
    measured = MeasurementSession.objects.filter(device=OuterRef("device"), front__application=application)
    rows = list(
        DeviceActivity.objects.filter(simulated_only(simulated), Exists(measured)).exclude(
            device__in=figured.values("device")
        )
    )
    found = devices_of(row.device_id for row in rows)
    listed = (
        DeviceRow(found[row.device_id], row.sessions, row.installations, hour(row.last_session_at), None)
        for row in rows
    )
    return tuple(sorted(listed, key=lambda row: row.device.slug))


def device(slug: str, application: str | None = None) -> DeviceDetail | None:
    """One device: every configuration, newest front first; newest sessions; all of APPLICATION alone where
    one is given, but for the counts of sessions and installations, which are over all of them. The latest
    session is the newest that counts for the figure of best, else the newest.

    None for an unknown SLUG, and for the name of a model that is masked.
    """
    model = find(slug)
    if model is None:
        return None
    of_one = {} if application is None else {"front__application": application}
    sessions = session_rows().filter(device=model, **of_one)
    listed = tuple(sessions[:LISTED_SESSIONS])
    if not listed:
        return None
    rows = DeviceSpeedup.objects.filter(device=model, **of_one).order_by("-front__published_at", "-speedup")
    speedups_of = tuple(figures(rows))
    activity = DeviceActivity.objects.filter(device=model).first()
    return DeviceDetail(
        device=device_of(model),
        speedups=speedups_of,
        sessions=tuple(session_row(row) for row in listed),
        # Before the first summary of a device its sessions are not counted.
        session_count=activity.sessions if activity else len(listed),
        installations=activity.installations if activity else 0,
        latest=session_detail(_leading_session(sessions, listed, speedups_of)),
    )


def _leading_session(
    sessions: QuerySet[MeasurementSession], listed: Sequence[MeasurementSession], rows: Iterable[Speedup]
) -> MeasurementSession:
    """The newest session behind the figure of best that leads on the front of the newest one; where no
    session counts, the newest with that backend, or of all. SESSIONS are all of a device, LISTED the newest.
    """
    newest = listed[0]
    of_front = [row for row in rows if (row.front, row.configuration) == (newest.front.slug, BEST)]
    backends = {row.backend for row in leading(of_front).values()}
    leads = [one for one in listed if one.front_id == newest.front_id and one.backend in backends]
    for one in leads:
        answer = session_row(one).speedup(BEST)
        if answer is not None and answer.state == State.VALID:
            return one
    if leads or not backends:
        return leads[0] if leads else newest
    return sessions.filter(front=newest.front_id, backend__in=backends).first() or newest
