"""Summarises sessions, in batches: few queries, and arrays instead of rows.

Everything here can run again at any time, also in several processes at once.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from datetime import UTC, datetime
from functools import partial
from typing import NamedTuple
from uuid import UUID

from django.db import transaction
from django.db.models import Count, F, Max, Min, Q, QuerySet
from django.utils import timezone

from crowd.database.prepared import insert
from crowd.devices.models import DeviceDescription, DeviceModel, Installation, ProcessorClass
from crowd.fronts.models import FrontVersion
from crowd.results.figures import cohorts
from crowd.results.figures.cohorts import KEY_COLUMNS, CohortKey
from crowd.results.figures.plausible import PlausibilityBounds
from crowd.results.models import (
    Cohort,
    DeviceActivity,
    MeasurementSession,
    SessionSummary,
    WorkerPulse,
)
from crowd.results.validity import sessions as session_validity
from crowd.results.validity import version
from crowd.results.validity.decisions import Decisions
from crowd.results.validity.runs import Front, SessionContext, judge_runs, mark_missed_copies
from crowd.results.validity.sessions import SessionInput
from wire.front import DEFAULT

# Sessions and cohorts per transaction, so that other writers wait less than a second.
BATCH = 200
COHORT_BATCH = 20
MARK_BATCH = 5_000
# The sweep computes the figures of a device with more sessions than this, for many new sessions at once. So
# the cost of a new session does not grow with the number of sessions.
LARGE_DEVICE_SESSIONS = 1_000
# Monitoring looks at no more waiting sessions of each kind: its answer must not cost more over time.
WAITING_LIMIT = 10_000

COLUMNS = ("pk", "installation_id", "started_at", "received_at", "description_id")


class SessionColumns(NamedTuple):
    """The key of a session's cohort, and its COLUMNS."""

    group: CohortKey
    key: int
    installation: UUID
    started_at: datetime
    received_at: datetime
    description: int


class Part(NamedTuple):
    """A part of all sessions, `number` (from 1) of `parts`: those of every `parts`-th device.

    Processes that summarise different parts never wait for each other's cohorts.
    """

    number: int
    parts: int


def waiting_sessions(part: Part | None = None) -> QuerySet[MeasurementSession]:
    """Sessions without a summary by the current statistics: new ones, and all after a change of these."""
    waiting = MeasurementSession.objects.filter(
        Q(summary_algorithm=None) | Q(summary_algorithm__lt=version.ALGORITHM)
    ).order_by("id")
    return sessions_of(part, waiting)


def sessions_of(part: Part | None, sessions: QuerySet[MeasurementSession]) -> QuerySet[MeasurementSession]:
    """Those of `sessions` that are of `part`; without a part, all of them."""
    if part is None:
        return sessions
    return sessions.alias(part=F("device_id") % part.parts).filter(part=part.number - 1)


def count_waiting() -> tuple[int, datetime | None]:
    """How many sessions wait, and when the oldest of them arrived.

    At most WAITING_LIMIT new ones and as many with an outdated summary are looked at: after a change of the
    statistics, all wait.
    """
    sessions = MeasurementSession.objects
    parts = [
        part[:WAITING_LIMIT].aggregate(count=Count("pk"), oldest=Min("received_at"))
        for part in (
            sessions.filter(summary_algorithm=None).order_by("id"),
            sessions.filter(summary_algorithm__lt=version.ALGORITHM).order_by("summary_algorithm", "id"),
        )
    ]
    arrivals = [part["oldest"] for part in parts if part["oldest"]]
    return sum(part["count"] for part in parts), min(arrivals, default=None)


def mark_for_summary(sessions: QuerySet[MeasurementSession]) -> int:
    """Mark `sessions` for a new summary; returns how many. Their old summaries stay until then."""
    last, marked = 0, 0
    seen = sessions.exclude(summary_algorithm=None).order_by("pk")
    while keys := list(seen.filter(pk__gt=last).values_list("pk", flat=True)[:MARK_BATCH]):
        MeasurementSession.objects.filter(pk__in=keys).update(summary_algorithm=version.OUTDATED)
        last, marked = keys[-1], marked + len(keys)
    return marked


def summarise_waiting(limit: int | None = None, figures: bool = True, part: Part | None = None) -> list[int]:
    """Summarise at most `limit` waiting sessions of `part`, new ones first, then the oldest. Returns their
    keys.

    Without `figures`, these stay unchanged until `refresh_stale`.
    """
    done: list[int] = []
    for sessions in (
        waiting_sessions(part).filter(summary_algorithm=None),
        waiting_sessions(part).exclude(summary_algorithm=None),
    ):
        last = 0
        while room := BATCH if limit is None else min(BATCH, limit - len(done)):
            keys = list(sessions.filter(pk__gt=last).values_list("pk", flat=True)[:room])
            if not keys:
                break
            summarise_sessions(keys, figures)
            last = keys[-1]
            done += keys
    return done


def record_pulse(task: str) -> None:
    """Record that `task` ran now."""
    WorkerPulse.objects.update_or_create(task=task, defaults={"at": timezone.now()})


@transaction.atomic
def summarise_sessions(keys: Sequence[int], figures: bool = True) -> None:
    """Judge the runs of the sessions `keys`, summarise them and, with `figures`, compute their figures.

    Deleted sessions are skipped. The figures of large devices wait for `refresh_stale`.
    """
    transaction.on_commit(partial(mark_missed_copies, keys))
    lock_installations(MeasurementSession.objects.filter(pk__in=keys))
    sessions = _lock_sessions(keys)
    present = [session.key for session in sessions]
    earlier = SessionSummary.objects.filter(session__in=present)
    day_keys = set(earlier.values_list("cohort_id", "installation_id", "day"))
    # A session whose device was renamed or merged moves to another cohort.
    groups = _lock_cohorts(sessions, {cohort for cohort, _, _ in day_keys})
    if day_keys:
        earlier.delete()
    made = _summaries(sessions, {row.key: groups[row.group].pk for row in sessions}, Decisions.on(present))
    insert(made)
    # If a session has left, a later one may count instead.
    cohorts.apply_daily_limit_at(day_keys | {(row.cohort_id, row.installation_id, row.day) for row in made})
    MeasurementSession.objects.filter(pk__in=present).update(summary_algorithm=version.ALGORITHM)
    small = _small_devices(groups.values(), sessions) if figures else set()
    cohorts.refresh_figures([cohort for cohort in groups.values() if cohort.device_id in small])
    count_activity(small)
    later = [row.pk for row in groups.values() if row.device_id not in small and not row.stale]
    if later:
        Cohort.objects.filter(pk__in=later).update(stale=True)


def summarise_session(key: int) -> None:
    """Summarise the session `key` and compute the figures of its device. A deleted session is skipped."""
    summarise_sessions([key])


def refresh_stale() -> int:
    """Compute the figures of all stale cohorts; returns how many."""
    keys = list(Cohort.objects.filter(stale=True).order_by("pk").values_list("pk", flat=True))
    plausible = PlausibilityBounds()
    for begin in range(0, len(keys), COHORT_BATCH):
        with transaction.atomic():
            locked = cohorts.lock_cohorts(Cohort.objects.filter(pk__in=keys[begin : begin + COHORT_BATCH]))
            cohorts.refresh_figures(locked, plausible)
            count_activity({cohort.device_id for cohort in locked})
    return len(keys)


def lock_installations(sessions: QuerySet[MeasurementSession]) -> None:
    """Protect the installations of `sessions` from erasure until the transaction ends.

    To avoid deadlocks, writers lock installations first, then models, sessions and cohorts, each in the order
    of their keys. `no_key` lets others store rows that refer to the installations.
    """
    rows = Installation.objects.filter(pk__in=sessions.order_by().values("installation"))
    list(rows.select_for_update(no_key=True).order_by("pk").values_list("pk"))


def count_activity(devices: Iterable[int]) -> None:
    """Count the sessions and installations of `devices`. A device without sessions gets no row."""
    counts = (
        MeasurementSession.objects.filter(device_id__in=set(devices))
        .order_by("device_id")
        .values("device_id")
        .annotate(
            sessions=Count("id"), installations=Count("installation", distinct=True), last=Max("started_at")
        )
    )
    rows = [
        DeviceActivity(
            device_id=row["device_id"],
            sessions=row["sessions"],
            installations=row["installations"],
            last_session_at=row["last"],
        )
        for row in counts
    ]
    gone = set(devices) - {row.device_id for row in rows}
    DeviceActivity.objects.filter(device_id__in=gone).delete()
    DeviceActivity.objects.bulk_create(
        rows,
        update_conflicts=True,
        unique_fields=["device"],
        update_fields=["sessions", "installations", "last_session_at"],
    )


def _lock_sessions(keys: Sequence[int]) -> list[SessionColumns]:
    """Lock the sessions `keys`, in order, until the transaction ends. Deleted ones are skipped."""
    rows = MeasurementSession.objects.select_for_update().filter(pk__in=keys).order_by("pk")
    size = len(KEY_COLUMNS)
    return [
        SessionColumns(CohortKey(*row[:size]), *row[size:])
        for row in rows.values_list(*KEY_COLUMNS, *COLUMNS)
    ]


def _summaries(
    sessions: Sequence[SessionColumns], groups: Mapping[int, int], decisions: Decisions
) -> list[SessionSummary]:
    """Judge the runs of `sessions` and summarise them. Stores the states of runs, but not the summaries.

    `groups`: the key of each session's cohort. At most eight queries.
    """
    fronts = _fronts({row.group.front_id for row in sessions})
    context = {row.key: SessionContext(row.installation, fronts[row.group.front_id]) for row in sessions}
    runs = judge_runs(context, decisions)
    emulators = _emulators({row.description for row in sessions})
    inputs = [
        SessionInput(
            key=row.key,
            cohort=groups[row.key],
            installation=row.installation,
            started_at=row.started_at,
            # The daily limit uses the clock of the server: that of a client may be wrong.
            day=row.received_at.astimezone(UTC).date(),
            front=fronts[row.group.front_id],
            on_processor=row.group.processor_class == ProcessorClass.CPU,
            emulated=row.description in emulators,
            released=decisions.released(row.key),
        )
        for row in sessions
    ]
    return session_validity.summarise(inputs, runs)


def _fronts(keys: Collection[int]) -> dict[int, Front]:
    rows = FrontVersion.objects.filter(pk__in=keys).prefetch_related("configurations")
    return {row.pk: front_of(row) for row in rows}


def front_of(row: FrontVersion) -> Front:
    """What runs of the front `row` are judged by."""
    content, keys = row.content, {one.name: one.pk for one in row.configurations.all()}
    protocol = content.protocol
    return Front(
        key=row.pk,
        protocol=protocol,
        configurations=frozenset(keys.values()),
        baseline=keys.get(DEFAULT),
        bands={keys[point.name]: point.band for point in content.every if point.band is not None},
        order=frozenset(keys[name] for name in protocol.order if name in keys),
        skipped={keys[point.name]: point.skipped for point in content.every if point.skipped is not None},
    )


def _emulators(descriptions: Collection[int]) -> set[int]:
    """Those of `descriptions` (keys) that are of emulators."""
    rows = DeviceDescription.objects.filter(pk__in=descriptions, model__kind=DeviceModel.Kind.EMULATOR)
    return set(rows.values_list("pk", flat=True))


def _small_devices(groups: Iterable[Cohort], sessions: Iterable[SessionColumns]) -> set[int]:
    """Keys of the devices of `groups` and `sessions` whose figures are quick to compute."""
    devices = {cohort.device_id for cohort in groups} | {session.group.device_id for session in sessions}
    large = DeviceActivity.objects.filter(device__in=devices, sessions__gt=LARGE_DEVICE_SESSIONS)
    return devices - set(large.values_list("device_id", flat=True))


def _lock_cohorts(sessions: Iterable[SessionColumns], left: set[int]) -> dict[CohortKey, Cohort]:
    """Lock the cohorts of `sessions`, created where missing, and those with the keys `left`."""
    groups = {session.group for session in sessions}
    of_devices = Cohort.objects.filter(Q(pk__in=left) | Q(device__in={group.device_id for group in groups}))
    locked = {
        cohorts.cohort_key(cohort): cohort
        for cohort in cohorts.lock_cohorts(of_devices)
        if cohort.pk in left or cohorts.cohort_key(cohort) in groups
    }
    for group in sorted(groups - locked.keys()):
        made, _ = Cohort.objects.get_or_create(**group._asdict())
        # Another writer may have created it just now.
        [locked[group]] = cohorts.lock_cohorts(Cohort.objects.filter(pk=made.pk))
    return locked
