"""Assigns probes: further configurations that an installation is asked to measure, with the reason."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any

from django.conf import settings
from django.db import transaction
from django.db.models import Avg, Exists, OuterRef
from django.utils import timezone

from crowd.devices.models import Installation
from crowd.fronts import selectors as fronts
from crowd.fronts.content import plans
from crowd.fronts.models import Configuration
from crowd.predictions import maps, recommendations, tables
from crowd.predictions.expectations import FrontPrediction, LearnedMap, device_belief, predict, relatives
from crowd.predictions.measurements import SESSION_CONFIGURATIONS, Group, Row, assigned_to
from crowd.predictions.models import ProbeAssignment, ProbeRequest
from crowd.predictions.tables import CrowdTable
from crowd.results.models import MeasurementSession, Run, SessionSummary, State
from pareto.devices import probes
from pareto.devices.device_map import SEPARATOR
from wire.front import BEST, DEFAULT, Front, Point
from wire.protocol import MAX_DRIFT, PROBE_PAIRS

MAX_ASSIGNED = 3
MAX_MINUTES = 10.0
REPEAT_FOR = timedelta(days=1)  # for so long, an unmeasured assignment is given again
CONFIRMS = "It is predicted to be best for this device. Measuring it shows whether that is true."
TEACHES = "Its time improves predictions for this device and similar ones most."
TOO_HOT = "This device slowed down during the last session: let it cool first."
TOO_SLOW = "One more configuration would take longer than that on this device."
NO_SESSION = "Measure default and best first."
NOT_READY = "The server has not processed the last session yet: ask again in a minute."


@dataclass(frozen=True)
class AssignedProbe:
    """A point or probe of a front, with the reason to measure it."""

    point: Point
    why: str


@dataclass(frozen=True)
class Assignment:
    """What an installation shall measure next. `message` says why there is nothing."""

    front: Front
    probes: tuple[AssignedProbe, ...]
    message: str | None = None


def assign(installation: Installation, application: str | None, minutes: float) -> Assignment | None:
    """Assign up to MAX_ASSIGNED configurations to `installation` that take at most `minutes`, and store them.

    Unmeasured configurations of its last request come again. Otherwise: first one that confirms a
    recommendation, then requests of administrators, then those that improve predictions most. None if no
    front is published.
    """
    named = fronts.current_name(application)
    front = None if named is None else fronts.front(named[0])
    if front is None:
        return None
    session = MeasurementSession.objects.filter(
        installation=installation, front__slug=front.slug
    ).first()  # the newest
    if session is None:
        return Assignment(front, (), NO_SESSION)
    if session.summary_algorithm is None:
        return Assignment(front, (), NOT_READY)
    if SessionSummary.objects.filter(session=session, drift__gt=MAX_DRIFT).exists():
        return Assignment(front, (), TOO_HOT)
    seconds = _default_seconds(session)
    if seconds is None or not tables.is_predictable(front):
        return Assignment(front, (), NO_SESSION)
    done = _done_configurations(session)
    device = _Device.of(front, session)
    rows = [] if _pending_probes(front, session, done) else _choose_probes(device, done)
    with transaction.atomic():
        # Meanwhile it may have been erased, or another of its requests may have been answered.
        if not Installation.objects.select_for_update(no_key=True).filter(pk=installation.pk).first():
            return Assignment(front, (), NO_SESSION)
        pending = _pending_probes(front, session, done)
        assigned = pending or [AssignedProbe(_point(front, row.configuration.name), row.why) for row in rows]
        within = _fit_into_time(front, device.expected, seconds, assigned, minutes)
        kept = set() if pending else {one.point.name for one in within}
        ProbeAssignment.objects.bulk_create(row for row in rows if row.configuration.name in kept)
    if not within:
        return Assignment(front, (), TOO_SLOW if assigned else None)
    return Assignment(front, tuple(within))


@dataclass(frozen=True)
class _Device:
    """The device of an installation's newest session, with its table, its map and its prediction.

    Others count for these only with confirmed figures.
    """

    front: Front
    session: MeasurementSession
    table: CrowdTable
    learned: LearnedMap
    map_made_at: datetime | None
    row: str
    series: str
    expected: FrontPrediction

    @classmethod
    def of(cls, front: Front, session: MeasurementSession) -> "_Device":
        group = Group(session.front_id, session.backend, session.processor_class)
        near = tables.neighbours(group, session.processor, session.device_id)
        table = tables.read_table(front, group, near, session.installation)
        device_map = maps.find_map(group)
        learned = maps.learned_map(device_map, front)
        made_at = None if device_map is None else device_map.made_at
        row, series = (
            Row(session.device_id, session.processor).name,
            tables.chip_series(session.processor),
        )
        expected = predict(front, table, learned, row, series)
        return cls(front, session, table, learned, made_at, row, series, expected)


def _done_configurations(session: MeasurementSession) -> set[str]:
    """The configurations that the installation of `session` need not measure with the same backend and chip.

    They were measured, failed or lost the camera, or their session is not summarised yet. Those of an
    incomplete session, or one whose speedup changed, may be measured again.
    """
    criteria = {
        "session__installation": session.installation_id,
        "session__front": session.front_id,
        "session__backend": session.backend,
        "session__processor": session.processor,
    }
    judged = SessionSummary.objects.filter(**criteria).exclude(state=State.SUSPECT)
    waiting = Run.objects.filter(**criteria, session__summary_algorithm=None)
    names = (rows.values_list("configuration__name", flat=True) for rows in (judged, waiting))
    return {*SESSION_CONFIGURATIONS, *(name for each in names for name in each)}


def _default_seconds(session: MeasurementSession) -> float | None:
    """The mean seconds per frame of the default in `session`; None without a finished run."""
    runs = session.runs.filter(configuration__name=DEFAULT, status=Run.Status.OK)
    mean = runs.aggregate(mean=Avg("mean_us"))["mean"]
    return None if mean is None else float(mean) / 1e6


def _pending_probes(front: Front, session: MeasurementSession, done: set[str]) -> list[AssignedProbe]:
    """Recent assignments that are not measured yet; those from before the clock was set back are old."""
    now = timezone.now()
    rows = ProbeAssignment.objects.filter(
        installation=session.installation_id,
        configuration__front=session.front_id,
        backend=session.backend,
        processor=session.processor,
        assigned_at__range=(now - REPEAT_FOR, now),
    ).exclude(configuration__name__in=done)
    recent = rows.select_related("configuration").order_by("pk")[:MAX_ASSIGNED]
    return [AssignedProbe(_point(front, row.configuration.name), row.why) for row in recent]


def _choose_probes(device: _Device, done: set[str]) -> list[ProbeAssignment]:
    """Up to MAX_ASSIGNED unsaved assignments of configurations that are not `done`."""
    front, session, table = device.front, device.session, device.table
    columns = list(table.known.ratios.columns)
    open_names = [
        point.name
        for point in (*front.points, *front.probes)
        if point.name in columns
        and point.name not in done
        and _supports_backend(front, point, session.backend)
    ]
    keys = {row.name: row for row in Configuration.objects.filter(front=session.front_id)}
    seed = _seed(session.installation, len(done))
    rows: list[ProbeAssignment] = []

    def add(name: str, why: str, **members: Any) -> None:
        rows.append(
            ProbeAssignment(
                installation=session.installation,
                configuration=keys[name],
                backend=session.backend,
                processor=session.processor,
                why=why,
                seed=seed,
                map_made_at=device.map_made_at,
                **members,
            )
        )
        open_names.remove(name)

    advice = _recommended_name(device.expected)
    if advice in open_names:
        add(advice, CONFIRMS)
    for request in _open_requests(session):
        if len(rows) < MAX_ASSIGNED and request.configuration.name in open_names:
            why = f"The administrators request it: {request.reason}"
            add(request.configuration.name, why, request=request)
    beliefs = [
        device_belief(table, device.learned, name, device.series)
        for name in (device.row, *relatives(table, device.row, device.series))
    ]
    wanted = [column for column, name in enumerate(columns) if SEPARATOR not in name]
    candidates = [columns.index(name) for name in open_names]
    for choice in probes.choose(beliefs[0], beliefs[1:], candidates, wanted, MAX_ASSIGNED - len(rows), seed):
        gains = {columns[column]: round(gain, 6) for column, gain in choice.gains.items()}
        add(columns[choice.place], TEACHES, gains=gains)
    return rows


def _recommended_name(expected: FrontPrediction) -> str:
    """The recommended configuration, if it is not the published best; else ""."""
    try:
        name = recommendations.recommend(expected).configuration
    except recommendations.LimitsNotMetError:
        return ""
    return "" if name == BEST else name


def _open_requests(session: MeasurementSession) -> Sequence[ProbeRequest]:
    """The unfulfilled requests for the chip of `session`, oldest first.

    A session counts if its configuration was assigned. Where figures need confirmation, so does a request: a
    network counts once.
    """
    requests = ProbeRequest.objects.filter(active=True, configuration__front=session.front_id)
    unfulfilled = []
    for request in requests.select_related("configuration").order_by("pk"):
        if request.chip.casefold() in session.processor.casefold():
            there = SessionSummary.objects.filter(
                Exists(assigned_to(OuterRef("installation"), OuterRef("configuration"))),
                configuration=request.configuration,
                cohort__processor__icontains=request.chip,
                state=State.VALID,
            )
            sources = (
                there.values("installation__network").distinct() if settings.FRONTRUNNER_QUORUM > 1 else there
            )
            if sources.count() < request.sessions:
                unfulfilled.append(request)
    return unfulfilled


def _fit_into_time(
    front: Front,
    expected: FrontPrediction,
    seconds: float,
    assigned: Sequence[AssignedProbe],
    minutes: float,
) -> list[AssignedProbe]:
    """The first of `assigned` that fit into `minutes` together with the default, warm-up included.

    `seconds`: time per frame of the default.
    """
    frames = PROBE_PAIRS * front.protocol.frames + front.protocol.warmup_frames
    ratios = {point.configuration: point.low for point in expected.points}
    left = 60 * min(minutes, MAX_MINUTES) - frames * seconds
    kept = []
    for one in assigned:
        left -= frames * seconds / ratios[one.point.name]
        if left < 0:
            break
        kept.append(one)
    return kept


def _supports_backend(front: Front, point: Point, backend: str) -> bool:
    plan = plans.of_point(front, point)
    return plan is None or backend in plan.backends


def _point(front: Front, name: str) -> Point:
    return next(point for point in (*front.points, *front.probes) if point.name == name)


def _seed(installation: Installation, number: int) -> int:
    """A seed that is the same for the same request: by installation and number of done configurations."""
    digest = hashlib.sha256(f"{installation.pk} {number}".encode()).digest()
    return int.from_bytes(digest[:6], "big")
