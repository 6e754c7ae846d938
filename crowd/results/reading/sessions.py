"""Reads of sessions, runs and submissions."""

import json
from collections.abc import Iterable, Mapping
from typing import Any
from uuid import UUID

from django.db.models import Prefetch, Q, QuerySet

from crowd.devices.disclosure import public_device
from crowd.devices.models import DeviceModel, Installation
from crowd.fronts.content.protocol import first_counted_frame
from crowd.fronts.selectors import BEST
from crowd.records.device import Device
from crowd.records.record import columns_of
from crowd.records.run import OF_SESSION, RunRow
from crowd.records.session import SessionRow, SessionSpeedup
from crowd.results.figures import statistics
from crowd.results.intake import packing
from crowd.results.intake.admission import REJECTED
from crowd.results.intake.stages import STAGES
from crowd.results.models import MeasurementSession, Run, SessionSummary, Submission, Tombstone
from crowd.results.public_rows import round_to_hour
from crowd.results.reading.public_texts import public_failure
from crowd.results.reading.rows import RunDetail, RunSeries, SessionDetail, SubmissionRow

LISTED_SESSIONS = 20
RECENT = 60  # sessions, among which several devices are looked for


def latest_sessions(limit: int = LISTED_SESSIONS, front: str | None = None) -> tuple[SessionRow, ...]:
    """The sessions received last, newest first; of `front`, if given. Two queries."""
    # The keys come from an index. With more columns in this query, SQLite would sort all sessions.
    of_one = {} if front is None else {"front__slug": front}
    newest = MeasurementSession.objects.filter(**of_one).values("pk")[:limit]
    return tuple(session_row(row) for row in session_queryset().filter(pk__in=newest))


def latest_by_device(limit: int, front: str | None = None) -> tuple[SessionRow, ...]:
    """The newest session with `best` of each of `limit` devices, newest first, among the RECENT ones.

    Three queries. Only the sessions that are returned are loaded whole.
    """
    answers = SessionSummary.objects.filter(configuration__name=BEST)
    if front is not None:
        answers = answers.filter(configuration__front__slug=front)
    received = answers.order_by("-session_id").values("session_id")[:RECENT]
    recent = MeasurementSession.objects.filter(pk__in=received).select_related("device").only("device")
    newest: dict[str, int] = {}
    for session in recent:
        newest.setdefault(public_device(session.device).slug, session.pk)
    rows = session_queryset().filter(pk__in=list(newest.values())[:limit])
    return tuple(session_row(row) for row in rows)


def own_sessions(installation: Installation, model: DeviceModel, limit: int) -> tuple[SessionRow, ...]:
    """The sessions of `installation` on `model` or its aliases, newest first. Two queries."""
    of_model = Q(description__model=model) | Q(description__model__canonical=model)
    return tuple(
        session_row(row) for row in session_queryset().filter(of_model, installation=installation)[:limit]
    )


def session(uuid: UUID) -> SessionDetail | None:
    """A session with the series of all its runs; None if unknown. Three queries."""
    row = session_queryset().filter(uuid=uuid).first()
    return None if row is None else session_detail(row)


def run(uuid: UUID) -> RunDetail | None:
    """A run with its session; None if unknown. Three queries."""
    row = Run.objects.select_related("configuration", "frames").filter(uuid=uuid).first()
    if row is None:
        return None
    around = session_queryset().get(pk=row.session_id)
    session = session_row(around)
    return RunDetail(
        run=_series(row, session, around.front.protocol),
        session=session,
        protocol=around.front.protocol,
        driver=around.driver,
        parameters=row.configuration.parameters,
    )


def submission(installation: Installation, key: UUID) -> SubmissionRow | None:
    """The submission `key` of `installation` with its sessions; None if unknown. Three queries."""
    row = Submission.objects.filter(installation=installation, pk=key).first()
    if row is None:
        return None
    # A session in several parts belongs to the submission of its first run. The ids of runs find it, too.
    items = json.loads(row.answer)["items"]
    uuids = [item["id"] for item in items if item["status"] != REJECTED]
    sessions = (
        session_queryset()
        .filter(Q(submission=row) | Q(runs__uuid__in=uuids, installation=installation))
        .distinct()
    )
    return SubmissionRow(
        id=row.pk,
        received_at=row.received_at,
        items=items,
        sessions=tuple(session_row(each) for each in sessions),
    )


def session_queryset() -> QuerySet[MeasurementSession]:
    """Sessions with the relations that `session_row` reads."""
    answers = SessionSummary.objects.select_related("configuration", "baseline").order_by(
        "configuration__position"
    )
    return MeasurementSession.objects.select_related("device", "front").prefetch_related(
        Prefetch("summaries", queryset=answers)
    )


def session_row(row: MeasurementSession) -> SessionRow:
    """`row` as a row of a list."""
    answers = (
        session_speedup(vars(answer), answer.configuration.name, answer.baseline.name)
        for answer in row.summaries.all()
    )
    return make_session_row(
        vars(row), public_device(row.device), row.front.application, row.front.slug, answers
    )


def make_session_row(
    row: Mapping[str, Any],
    device: Device,
    application: str,
    front: str,
    speedups: Iterable[SessionSpeedup],
) -> SessionRow:
    """The columns of a session, `row`, on `device` with a `front` of `application`."""
    extra = {
        "device": device,
        "application": application,
        "front": front,
        "started_at": round_to_hour(row["started_at"]),
        "received_at": round_to_hour(row["received_at"]),
        "summarised": row["summary_algorithm"] is not None,
        "speedups": tuple(speedups),
    }
    return SessionRow(**{name: row[name] for name in columns_of(MeasurementSession, SessionRow)} | extra)


def session_speedup(row: Mapping[str, Any], configuration: str, baseline: str) -> SessionSpeedup:
    """The columns of a summary, `row`, as the speedup of `configuration` over `baseline`."""
    values = {name: row[name] for name in columns_of(SessionSummary, SessionSpeedup)}
    for name, log in (("speedup", row["log_ratio"]), ("low", row["low"]), ("high", row["high"])):
        values[name] = None if log is None else statistics.ratio(log)
    return SessionSpeedup(configuration=configuration, baseline=baseline, **values)


def session_detail(row: MeasurementSession) -> SessionDetail:
    """`row` with the series of all its runs. One more query."""
    session = session_row(row)
    runs: Iterable[Any] = row.runs.select_related("configuration", "frames").order_by("order")
    return SessionDetail(
        session=session,
        protocol=row.front.protocol,
        driver=row.driver,
        samples=row.samples,
        runs=tuple(_series(each, session, row.front.protocol) for each in runs),
    )


def _series(row: Run, session: SessionRow, protocol: Mapping[str, Any]) -> RunSeries:
    series = packing.decompress(row.frames.content)
    tracked = tuple(packing.unpack_tracked(series.tracked))
    counted = tracked[first_counted_frame(protocol) :]
    return RunSeries(
        run=make_run_row(
            vars(row),
            row.configuration.name,
            {"session": session.uuid} | {name: getattr(session, name) for name in OF_SESSION[1:]},
        ),
        frame_seconds=packing.seconds(packing.unpack(series.frame_us)),
        stage_seconds={
            name: packing.seconds(times)
            for name, times in packing.unpack_stages(series.stages, series.stages_us).items()
            if name in STAGES
        },
        tracked=tracked,
        skipped=counted.count(None) / len(counted)
        if counted and row.configuration.skipped is not None
        else None,
        first_counted=first_counted_frame(protocol),
    )


def make_run_row(row: Mapping[str, Any], configuration: str, around: Mapping[str, Any]) -> RunRow:
    """The columns of a run of `configuration`, `row`, with those of its session, `around`."""
    extra = {"configuration": configuration, "failure": public_failure(row["failure"])}
    return RunRow(**{name: row[name] for name in columns_of(Run, RunRow)} | extra, **around)


def single_deletions() -> int:
    """The number of runs that participants deleted individually. One query over an index.

    Deleting chosen runs can change a figure. This counts how often that may have happened.
    """
    return Tombstone.objects.filter(single=True).count()
