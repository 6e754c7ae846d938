"""Paginated lists of sessions and of runs, newest first.

They are ordered by the start of the session, its primary key and the run's primary key. A page starts after
the row with a given id, so that new and deleted rows do not shift the pages.
"""

from collections.abc import Collection, Sequence
from typing import Any
from uuid import UUID

from django.db.models import Exists, OuterRef, Q, QuerySet
from django.db.models.functions import Coalesce

from crowd.devices.naming.chips import vendor
from crowd.fronts.models import FrontVersion
from crowd.records.record import columns_of
from crowd.records.run import RunRow
from crowd.records.session import SessionRow
from crowd.results.figures.confirmation import confirmed
from crowd.results.models import (
    Cohort,
    DeviceSpeedup,
    MeasurementSession,
    Outcome,
    Run,
    SessionSummary,
    State,
)
from crowd.results.public_rows import read_devices, round_to_hour
from crowd.results.reading.devices import public_devices
from crowd.results.reading.queries.list_filters import RunFilters, SessionFilters
from crowd.results.reading.sessions import make_run_row, session_rows
from crowd.results.reading.speedups import matches, period_bounds
from wire.front import BEST

# With more sessions than this, a page is found by scanning the list; with fewer, by the index of devices.
MANY_SESSIONS = 5_000
CHIP_COLUMNS = ("backend", "processor", "processor_class")
# The columns that sessions of a cohort, and its figures, have in common.
COHORT_COLUMNS = ("device", "front", *CHIP_COLUMNS)
RUN_COLUMNS = columns_of(Run, RunRow)


def sessions(filters: SessionFilters, limit: int, after: str | None) -> Sequence[SessionRow] | None:
    """The first `limit` sessions matching `filters` after the session `after` (an id); None if it does not
    exist.

    At most ten queries, eleven for the first call after a change.
    """
    rows = _sessions(filters)
    if filters.configuration or filters.valid is not None:
        answers = SessionSummary.objects.filter(_conditions(filters), session=OuterRef("pk"))
        rows = rows.filter(Exists(answers))
    if after is not None:
        if not _is_uuid(after):
            return None
        last = MeasurementSession.objects.filter(uuid=after).values_list("started_at", "pk").first()
        if last is None:
            return None
        started_at, key = last
        # The last condition lets the database start inside the index.
        rows = rows.filter(Q(started_at__lt=started_at) | Q(pk__lt=key), started_at__lte=started_at)
    newest = ("-started_at", "-pk")
    keys = rows.order_by(*newest).values_list("pk", flat=True)[:limit]
    return session_rows(MeasurementSession.objects.filter(pk__in=list(keys)).order_by(*newest))


def runs(filters: RunFilters, limit: int, after: str | None) -> Sequence[RunRow] | None:
    """The first `limit` runs matching `filters` after the run `after` (its id); None if that does not exist.

    At most ten queries, eleven for the first call after a change.
    """
    around = _sessions(filters)
    if filters.session is not None:
        around = around.filter(uuid=filters.session)
    rows = Run.objects.filter(_conditions(filters))
    if after is not None:
        if not _is_uuid(after):
            return None
        position = Run.objects.filter(uuid=after).values_list("session__started_at", "session_id", "pk")
        last = position.first()
        if last is None:
            return None
        started_at, session, key = last
        around = around.filter(Q(started_at__lt=started_at) | Q(pk__lte=session), started_at__lte=started_at)
        rows = rows.exclude(session_id=session, pk__gte=key)
    # Each of these sessions has at least one run, so LIMIT sessions are enough.
    having = around.filter(Exists(rows.filter(session=OuterRef("pk"))))
    keys = list(having.order_by("-started_at", "-pk").values_list("pk", flat=True)[:limit])
    ordered = rows.filter(session__in=keys).order_by("-session__started_at", "-session_id", "-pk")
    return _run_rows(ordered[:limit])


def _is_uuid(text: str) -> bool:
    try:
        UUID(text)
    except ValueError:
        return False
    return True


def _sessions(filters: SessionFilters) -> QuerySet[MeasurementSession]:
    """The sessions matching `filters`, without the filters on summaries and runs."""
    rows = MeasurementSession.objects.filter(**period_bounds(filters.since, filters.until))
    if not filters.apply_here:
        return rows.none()
    fronts = _front_keys(filters)
    if fronts is not None:
        rows = rows.filter(front__in=fronts)
    if filters.backend:
        rows = rows.filter(backend=filters.backend)
    if filters.vendor or filters.configuration or filters.confirmed is not None:
        cohorts = _cohort_devices(filters, fronts)
        if filters.vendor or filters.confirmed is not None:
            own_cohort = Cohort.objects.filter(
                pk__in=cohorts, **{name: OuterRef(name) for name in COHORT_COLUMNS}
            )
            rows = rows.filter(Exists(own_cohort))
        return _on_devices(rows, set(cohorts.values()))
    if any((filters.device, filters.soc, filters.gpu, filters.os)):
        return _on_devices(rows, _device_keys(filters))
    return rows


def _on_devices(rows: QuerySet[MeasurementSession], devices: Collection[int]) -> QuerySet[MeasurementSession]:
    """The `rows` that were measured on `devices`."""
    measured = MeasurementSession.objects.filter(device__in=devices).order_by().values_list("pk", flat=True)
    if len(measured[: MANY_SESSIONS + 1]) <= MANY_SESSIONS:
        return rows.filter(device__in=devices)
    # With the index of devices, a database would sort all their sessions. Coalesce hides the column from the
    # index: the condition is then tested in the order of the list until a page is full.
    return rows.annotate(model=Coalesce("device_id", 0)).filter(model__in=devices)


def _front_keys(filters: SessionFilters) -> list[int] | None:
    """The keys of the fronts that match `filters`; None for all."""
    if not (filters.front or filters.application):
        return None
    rows = FrontVersion.objects.filter(application=filters.application)
    if filters.front:
        rows = rows.filter(slug=filters.front)
    return list(rows.values_list("pk", flat=True))


def _device_keys(filters: SessionFilters) -> list[int]:
    """The keys of the models whose public data matches `filters`."""
    return [
        key
        for key, device in public_devices().items()
        if matches(filters, device, filters.vendor, filters.backend)
    ]


def _cohort_devices(filters: SessionFilters, fronts: list[int] | None) -> dict[int, int]:
    """The device of each cohort of `fronts` (None: all) that matches `filters`, by the cohort's key."""
    devices = public_devices()
    rows = Cohort.objects.all()
    if fronts is not None:
        rows = rows.filter(front__in=fronts)
    if filters.configuration:
        ran = Outcome.objects.filter(configuration__name=filters.configuration)
        rows = rows.filter(pk__in=ran.values("cohort"))
    confirmed_keys = set() if filters.confirmed is None else _confirmed_cohorts(filters)
    device_of = {}
    for key, device, *others in rows.values_list("pk", *COHORT_COLUMNS):
        _, backend, processor, kind = others
        if (
            device in devices
            and matches(filters, devices[device], vendor(processor, devices[device].gpu, kind), backend)
            and filters.confirmed in (None, (device, *others) in confirmed_keys)
        ):
            device_of[key] = device
    return device_of


def _confirmed_cohorts(filters: SessionFilters) -> set[tuple[Any, ...]]:
    """The values of COHORT_COLUMNS of the confirmed figures of the configuration in `filters`."""
    figures = DeviceSpeedup.objects.filter(
        confirmed(), configuration__name=filters.configuration or BEST, state=State.VALID
    )
    return set(figures.order_by().values_list(*COHORT_COLUMNS))


def _conditions(filters: SessionFilters) -> Q:
    """The conditions of `filters` on a summary or a run."""
    named = Q(configuration__name=filters.configuration) if filters.configuration else Q()
    if filters.valid is None:
        return named
    return named & (Q(state=State.VALID) if filters.valid else ~Q(state=State.VALID))


def _run_rows(selected: QuerySet[Run]) -> tuple[RunRow, ...]:
    """The runs `selected`, in order. Two queries."""
    rows = list(
        selected.values(
            *RUN_COLUMNS,
            "session__uuid",
            "session__device_id",
            "session__front__application",
            "session__front__slug",
            "session__started_at",
            "configuration__name",
            *(f"session__{name}" for name in CHIP_COLUMNS),
        )
    )
    devices = read_devices(row["session__device_id"] for row in rows)
    return tuple(
        make_run_row(
            row,
            row["configuration__name"],
            {
                "session": row["session__uuid"],
                "device": devices[row["session__device_id"]],
                "application": row["session__front__application"],
                "front": row["session__front__slug"],
                "started_at": round_to_hour(row["session__started_at"]),
            }
            | {name: row[f"session__{name}"] for name in CHIP_COLUMNS},
        )
        for row in rows
    )
