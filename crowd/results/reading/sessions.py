"""Reads of sessions, runs and submissions."""

import json
from collections.abc import Iterable
from typing import Any
from uuid import UUID

from django.db.models import Prefetch, Q, QuerySet

from crowd.devices.models import DeviceModel, Installation
from crowd.results.figures import statistics
from crowd.results.intake import packing
from crowd.results.intake.admission import REJECTED
from crowd.results.intake.stages import STAGES
from crowd.results.models import MeasurementSession, Run, SessionSummary, Submission, Tombstone
from crowd.results.reading.public_rows import round_to_hour, to_device
from crowd.results.reading.public_texts import public_failure
from crowd.results.reading.rows import (
    RunDetail,
    RunRow,
    RunSeries,
    SessionDetail,
    SessionRow,
    SessionSpeedup,
    SubmissionRow,
)

LISTED_SESSIONS = 20


def latest_sessions(limit: int = LISTED_SESSIONS, front: str | None = None) -> tuple[SessionRow, ...]:
    """The sessions received last, newest first; of FRONT, if given. Two queries."""
    # The keys come from an index. With more columns in this query, SQLite would sort all sessions.
    of_one = {} if front is None else {"front__slug": front}
    newest = MeasurementSession.objects.filter(**of_one).values("pk")[:limit]
    return tuple(session_row(row) for row in session_queryset().filter(pk__in=newest))


def own_sessions(installation: Installation, model: DeviceModel, limit: int) -> tuple[SessionRow, ...]:
    """The sessions of INSTALLATION on MODEL or its aliases, newest first. Two queries."""
    own = Q(description__model=model) | Q(description__model__canonical=model)
    return tuple(
        session_row(row) for row in session_queryset().filter(own, installation=installation)[:limit]
    )


def session(uuid: UUID) -> SessionDetail | None:
    """A session with the series of all its runs; None if unknown. Three queries."""
    row = session_queryset().filter(uuid=uuid).first()
    return None if row is None else session_detail(row)


def run(uuid: UUID) -> RunDetail | None:
    """A run with its session; None if unknown. Three queries."""
    row = Run.objects.select_related("configuration").filter(uuid=uuid).first()
    if row is None:
        return None
    around = session_queryset().get(pk=row.session_id)
    return RunDetail(
        run=_series(row),
        session=session_row(around),
        protocol=around.front.protocol,
        driver=around.driver,
        parameters=row.configuration.parameters,
    )


def submission(installation: Installation, key: UUID) -> SubmissionRow | None:
    """The submission KEY of INSTALLATION with its sessions; None if unknown. Three queries."""
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
    """ROW as a row of a list."""
    return SessionRow(
        uuid=row.uuid,
        device=to_device(row.device),
        application=row.front.application,
        front=row.front.slug,
        protocol_version=row.protocol_version,
        backend=row.backend,
        processor=row.processor,
        processor_class=row.processor_class,
        empty_frame_us=row.empty_frame_us,
        stage_clock=row.stage_clock,
        blocks_repeated=row.blocks_repeated,
        started_at=round_to_hour(row.started_at),
        received_at=round_to_hour(row.received_at),
        summarised=row.summary_algorithm is not None,
        speedups=tuple(_session_speedup(answer) for answer in row.summaries.all()),
    )


def _session_speedup(row: SessionSummary) -> SessionSpeedup:
    return SessionSpeedup(
        configuration=row.configuration.name,
        baseline=row.baseline.name,
        speedup=None if row.log_ratio is None else statistics.ratio(row.log_ratio),
        low=None if row.low is None else statistics.ratio(row.low),
        high=None if row.high is None else statistics.ratio(row.high),
        pairs=row.pairs,
        drift=row.drift,
        ate_max=row.ate_max,
        state=row.state,
        reason=row.reason,
    )


def session_detail(row: MeasurementSession) -> SessionDetail:
    """ROW with the series of all its runs. One more query."""
    runs: Iterable[Any] = row.runs.select_related("configuration").order_by("order")
    return SessionDetail(
        session=session_row(row),
        protocol=row.front.protocol,
        driver=row.driver,
        samples=row.samples,
        runs=tuple(_series(each) for each in runs),
    )


def _series(row: Run) -> RunSeries:
    return RunSeries(
        run=_run(row),
        frame_seconds=packing.seconds(packing.unpack(row.frame_us)),
        stage_seconds={
            name: packing.seconds(series)
            for name, series in packing.unpack_stages(row.stages, row.stages_us).items()
            if name in STAGES
        },
        tracked=tuple(packing.unpack_tracked(row.tracked)),
    )


def _run(row: Run) -> RunRow:
    return RunRow(
        uuid=row.uuid,
        configuration=row.configuration.name,
        repeat=row.repeat,
        order=row.order,
        status=row.status,
        failure=public_failure(row.failure),
        mean_seconds=None if row.mean_us is None else row.mean_us * 1e-6,
        tracked_frames=row.tracked_frames,
        ate_max=row.ate_max,
        ate_mean=row.ate_mean,
        ate_rmse=row.ate_rmse,
        deviation=row.deviation,
        cpu_us=row.cpu_us,
        waited_us=row.waited_us,
        state=row.state,
        reason=row.reason,
    )


def single_deletions() -> int:
    """The number of runs that participants deleted individually. One query over an index.

    Deleting chosen runs can change a figure. This counts how often that may have happened.
    """
    return Tombstone.objects.filter(single=True).count()
