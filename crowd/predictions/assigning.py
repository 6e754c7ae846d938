"""Which further configurations an installation is asked to measure, and why."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any

from django.db import transaction
from django.db.models import Avg
from django.utils import timezone

from crowd.devices.models import DeviceModel, Installation
from crowd.fronts import selectors as fronts
from crowd.fronts.content import plans
from crowd.fronts.models import Configuration
from crowd.fronts.selectors import BEST, DEFAULT, Front, Point
from crowd.predictions import maps, recommending, tables
from crowd.predictions.devices import Expectation, Learned, belief_of, expect, relatives
from crowd.predictions.models import ProbeAssignment, ProbeRequest
from crowd.predictions.tables import CrowdTable, Group
from crowd.results.models import MeasurementSession, Run, SessionSummary, State
from crowd.results.validity import rules
from pareto.devices import probes
from pareto.devices.device_map import SEPARATOR
from slam.protocol import PROBE_PAIRS

MOST = 3
MOST_MINUTES = 10.0
KEPT = timedelta(days=1)  # an assignment that was not measured is repeated for so long
HOT = frozenset({rules.THROTTLING.code, rules.DRIFT.code})
CONFIRMS = "It is predicted to be best for this device. Measuring it shows whether that is true."
TEACHES = "Its time tells most about this device and devices like it."
TOO_HOT = "This device slowed down while it measured: let it cool first."
TOO_SLOW = "One more configuration would take longer than that on this device."
NO_SESSION = "Measure default and best first."
NOT_READY = "The server still works through the last session: ask again in a minute."


@dataclass(frozen=True)
class Assigned:
    """A point or probe of a front, and why it is asked for."""

    point: Point
    why: str


@dataclass(frozen=True)
class Assignment:
    """What one installation shall measure next; `message` says why that is nothing."""

    front: Front
    probes: tuple[Assigned, ...]
    message: str | None = None


def assign(installation: Installation, application: str | None, minutes: float) -> Assignment | None:
    """Up to MOST configurations for INSTALLATION that take at most MINUTES, noted as rows; those of its last
    question where it did not measure them yet. None where no front is published.

    First what confirms a recommendation, then what administrators asked for, then what teaches most.
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
    if SessionSummary.objects.filter(session=session, reason__in=HOT, drift__gt=1).exists():
        return Assignment(front, (), TOO_HOT)
    seconds = _default_seconds(session)
    if seconds is None or not tables.is_predictable(front):
        return Assignment(front, (), NO_SESSION)
    done = _done(session)
    device = _Device.of(front, session)
    rows = [] if _pending(front, session, done) else _choose(device, done)
    with transaction.atomic():
        # Meanwhile it may have been erased, or another question of it answered.
        if not Installation.objects.select_for_update(no_key=True).filter(pk=installation.pk).first():
            return Assignment(front, (), NO_SESSION)
        pending = _pending(front, session, done)
        assigned = pending or [Assigned(_point(front, row.configuration.name), row.why) for row in rows]
        within = _within(front, device.expected, seconds, assigned, minutes)
        kept = set() if pending else {one.point.name for one in within}
        ProbeAssignment.objects.bulk_create(row for row in rows if row.configuration.name in kept)
    if not within:
        return Assignment(front, (), TOO_SLOW if assigned else None)
    return Assignment(front, tuple(within))


@dataclass(frozen=True)
class _Device:
    """The device of an installation's newest session, what is known of it and its relatives, and the map."""

    front: Front
    session: MeasurementSession
    table: CrowdTable
    learned: Learned
    map_made_at: datetime | None
    row: str
    series: str
    expected: Expectation

    @classmethod
    def of(cls, front: Front, session: MeasurementSession) -> "_Device":
        simulated = session.device.kind == DeviceModel.Kind.SIMULATED
        group = Group(session.front_id, session.backend, session.processor_class, simulated)
        table = tables.read(front, group, tables.neighbourhood(group, session.processor, session.device_id))
        found = maps.find(group)
        learned = maps.learned(found, front)
        made_at = None if found is None else found.made_at
        row, series = tables.row_name(session.device_id, session.processor), tables.family(session.processor)
        expected = expect(front, table, learned, row, series)
        return cls(front, session, table, learned, made_at, row, series, expected)


def _done(session: MeasurementSession) -> set[str]:
    """The configurations that the installation of SESSION need not be asked for with the same backend and
    chip: those that were measured well, failed or lost the camera, and those of sessions that are not worked
    through yet. A session that was cut short, or drifted, may be repeated.
    """
    own = {
        "session__installation": session.installation_id,
        "session__front": session.front_id,
        "session__backend": session.backend,
        "session__processor": session.processor,
    }
    judged = SessionSummary.objects.filter(**own).exclude(state=State.SUSPECT)
    waiting = Run.objects.filter(**own, session__summary_algorithm=None)
    names = (rows.values_list("configuration__name", flat=True) for rows in (judged, waiting))
    return {*tables.SESSION, *(name for found in names for name in found)}


def _default_seconds(session: MeasurementSession) -> float | None:
    """What a frame of the default took in SESSION; None where no run of it came to its end."""
    runs = session.runs.filter(configuration__name=DEFAULT, status=Run.Status.OK)
    mean = runs.aggregate(mean=Avg("mean_us"))["mean"]
    return None if mean is None else float(mean) / 1e6


def _pending(front: Front, session: MeasurementSession, done: set[str]) -> list[Assigned]:
    """What was assigned lately and is not measured yet."""
    rows = ProbeAssignment.objects.filter(
        installation=session.installation_id,
        configuration__front=session.front_id,
        backend=session.backend,
        processor=session.processor,
        assigned_at__gte=timezone.now() - KEPT,
    ).exclude(configuration__name__in=done)
    found = rows.select_related("configuration").order_by("pk")[:MOST]
    return [Assigned(_point(front, row.configuration.name), row.why) for row in found]


def _choose(device: _Device, done: set[str]) -> list[ProbeAssignment]:
    """Up to MOST rows, not stored yet, of configurations that are not DONE."""
    front, session, table = device.front, device.session, device.table
    columns = list(table.known.ratios.columns)
    open_names = [
        point.name
        for point in (*front.points, *front.probes)
        if point.name in columns and point.name not in done and _runs_with(front, point, session.backend)
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

    advice = _advice(device.expected)
    if advice in open_names:
        add(advice, CONFIRMS)
    for wish in _wishes(session):
        if len(rows) < MOST and wish.configuration.name in open_names:
            add(wish.configuration.name, f"The administrators ask for it: {wish.reason}", request=wish)
    beliefs = [
        belief_of(table, device.learned, name, device.series)
        for name in (device.row, *relatives(table, device.row, device.series))
    ]
    wanted = [place for place, name in enumerate(columns) if SEPARATOR not in name]
    candidates = [columns.index(name) for name in open_names]
    for choice in probes.choose(beliefs[0], beliefs[1:], candidates, wanted, MOST - len(rows), seed):
        gains = {columns[place]: round(gain, 6) for place, gain in choice.gains.items()}
        add(columns[choice.place], TEACHES, gains=gains)
    return rows


def _advice(expected: Expectation) -> str:
    """The configuration that is recommended for it, where that is not the published best."""
    try:
        name = recommending.choose(expected).configuration
    except recommending.NothingKeepsLimitsError:
        return ""
    return "" if name == BEST else name


def _wishes(session: MeasurementSession) -> Sequence[ProbeRequest]:
    """What administrators want of such a chip and do not have yet, oldest first."""
    wishes = ProbeRequest.objects.filter(active=True, configuration__front=session.front_id)
    found = []
    for wish in wishes.select_related("configuration").order_by("pk"):
        if wish.chip.casefold() in session.processor.casefold():
            there = SessionSummary.objects.filter(
                configuration=wish.configuration,
                cohort__processor__icontains=wish.chip,
                installation__simulated=session.installation.simulated,
                state=State.VALID,
            )
            if there.count() < wish.sessions:
                found.append(wish)
    return found


def _within(
    front: Front, expected: Expectation, seconds: float, assigned: Sequence[Assigned], minutes: float
) -> list[Assigned]:
    """The first of ASSIGNED that take at most MINUTES together with the default, warm-up included. A frame of
    the default takes SECONDS.
    """
    frames = PROBE_PAIRS * front.protocol["frames"] + front.protocol["warmup_frames"]
    ratios = {point.configuration: point.low for point in expected.points}
    left = 60 * min(minutes, MOST_MINUTES) - frames * seconds
    kept = []
    for one in assigned:
        left -= frames * seconds / ratios[one.point.name]
        if left < 0:
            break
        kept.append(one)
    return kept


def _runs_with(front: Front, point: Point, backend: str) -> bool:
    plan = plans.of_point(front, point)
    return plan is None or backend in plan.backends


def _point(front: Front, name: str) -> Point:
    return next(point for point in (*front.points, *front.probes) if point.name == name)


def _seed(installation: Installation, number: int) -> int:
    """The same for the same question: of which installation, after how many configurations."""
    digest = hashlib.sha256(f"{installation.pk} {number}".encode()).digest()
    return int.from_bytes(digest[:6], "big")
