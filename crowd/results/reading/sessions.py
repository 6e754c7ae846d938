"""Reads of sessions, runs and submissions."""

import json
from collections import defaultdict
from collections.abc import Iterable, Mapping
from typing import Any
from uuid import UUID

from django.db.models import Q, QuerySet

from crowd.devices.models import DeviceModel, Installation
from crowd.records.device import Device
from crowd.records.record import columns_of
from crowd.records.run import OF_SESSION, RunRow
from crowd.records.session import SessionRow, SessionSpeedup
from crowd.results.figures import statistics
from crowd.results.intake import packing
from crowd.results.intake.admission import REJECTED
from crowd.results.intake.stages import STAGES
from crowd.results.models import MeasurementSession, Run, SessionSummary, Submission, Tombstone
from crowd.results.public_rows import DEVICE_COLUMNS, devices_of, round_to_hour
from crowd.results.reading.public_texts import public_failure
from crowd.results.reading.rows import RunDetail, RunSeries, SessionDetail, SubmissionRow
from wire.front import BEST, Protocol, decoded

LISTED_SESSIONS = 20
RECENT = 60  # sessions, among which several devices are looked for
SESSION_COLUMNS = columns_of(MeasurementSession, SessionRow)
SUMMARY_COLUMNS = columns_of(SessionSummary, SessionSpeedup)


def latest_sessions(limit: int = LISTED_SESSIONS, front: str | None = None) -> tuple[SessionRow, ...]:
    """The sessions received last, newest first; of `front`, if given. Two queries."""
    # The keys come from an index. With more columns in this query, SQLite would sort all sessions.
    of_one = {} if front is None else {"front__slug": front}
    newest = MeasurementSession.objects.filter(**of_one).values("pk")[:limit]
    return session_rows(MeasurementSession.objects.filter(pk__in=newest))


def latest_by_device(limit: int, front: str | None = None) -> tuple[SessionRow, ...]:
    """The newest session with `best` of each of `limit` devices, newest first, among the RECENT ones.

    Three queries.
    """
    answers = SessionSummary.objects.filter(configuration__name=BEST)
    if front is not None:
        answers = answers.filter(configuration__front__slug=front)
    received = answers.order_by("-session_id").values("session_id")[:RECENT]
    recent = list(MeasurementSession.objects.filter(pk__in=received).values("pk", *DEVICE_COLUMNS))
    devices = devices_of(recent)
    newest: dict[str, int] = {}
    for row in recent:
        newest.setdefault(devices[row["device__pk"]].slug, row["pk"])
    return session_rows(MeasurementSession.objects.filter(pk__in=list(newest.values())[:limit]))


def own_sessions(installation: Installation, model: DeviceModel, limit: int) -> tuple[SessionRow, ...]:
    """The sessions of `installation` on `model` or its aliases, newest first. Two queries."""
    of_model = Q(description__model=model) | Q(description__model__canonical=model)
    return session_rows(MeasurementSession.objects.filter(of_model, installation=installation)[:limit])


def session(uuid: UUID) -> SessionDetail | None:
    """A session with the series of all its runs; None if unknown. Four queries."""
    rows = session_rows(MeasurementSession.objects.filter(uuid=uuid))
    return session_detail(rows[0]) if rows else None


def run(uuid: UUID) -> RunDetail | None:
    """A run with its session; None if unknown. Four queries."""
    row = Run.objects.select_related("configuration", "frames").filter(uuid=uuid).first()
    if row is None:
        return None
    around = MeasurementSession.objects.filter(pk=row.session_id)
    (session,) = session_rows(around)
    document, driver = around.values_list("front__document", "driver").get()
    content = decoded(document)
    (point,) = (point for point in content.every if point.name == row.configuration.name)
    return RunDetail(
        run=_series(row, session, content.protocol),
        session=session,
        protocol=content.protocol,
        driver=driver,
        parameters=dict(point.parameters),
    )


def submission(installation: Installation, key: UUID) -> SubmissionRow | None:
    """The submission `key` of `installation` with its sessions; None if unknown. Three queries."""
    row = Submission.objects.filter(installation=installation, pk=key).first()
    if row is None:
        return None
    # A session in several parts belongs to the submission of its first run. The ids of runs find it, too.
    items = json.loads(row.answer)["items"]
    uuids = [item["id"] for item in items if item["status"] != REJECTED]
    of_one = Q(submission=row) | Q(runs__uuid__in=uuids, installation=installation)
    return SubmissionRow(
        id=row.pk,
        received_at=row.received_at,
        items=items,
        sessions=session_rows(MeasurementSession.objects.filter(of_one).distinct()),
    )


def session_rows(selected: QuerySet[MeasurementSession]) -> tuple[SessionRow, ...]:
    """The sessions `selected` with their summaries, in order.

    Two queries, of the shown columns only: fronts are large.
    """
    found = list(
        selected.values(
            *("pk", "summary_algorithm", "front__application", "front__slug"),
            *SESSION_COLUMNS,
            *DEVICE_COLUMNS,
        )
    )
    devices = devices_of(found)
    speedups: dict[int, list[SessionSpeedup]] = defaultdict(list)
    summaries = SessionSummary.objects.filter(session__in=[row["pk"] for row in found])
    names = ("configuration__name", "baseline__name")
    for row in summaries.order_by("configuration__position").values(
        "session_id", "log_ratio", *names, *SUMMARY_COLUMNS
    ):
        speedups[row["session_id"]].append(_session_speedup(row))
    return tuple(_session_row(row, devices[row["device__pk"]], speedups[row["pk"]]) for row in found)


def _session_row(row: Mapping[str, Any], device: Device, speedups: Iterable[SessionSpeedup]) -> SessionRow:
    extra = {
        "device": device,
        "application": row["front__application"],
        "front": row["front__slug"],
        "started_at": round_to_hour(row["started_at"]),
        "received_at": round_to_hour(row["received_at"]),
        "summarised": row["summary_algorithm"] is not None,
        "speedups": tuple(speedups),
    }
    return SessionRow(**{name: row[name] for name in SESSION_COLUMNS} | extra)


def _session_speedup(row: Mapping[str, Any]) -> SessionSpeedup:
    values = {name: row[name] for name in SUMMARY_COLUMNS}
    for name, log in (("speedup", row["log_ratio"]), ("low", row["low"]), ("high", row["high"])):
        values[name] = None if log is None else statistics.ratio(log)
    return SessionSpeedup(configuration=row["configuration__name"], baseline=row["baseline__name"], **values)


def session_detail(session: SessionRow) -> SessionDetail:
    """`session` with the series of all its runs. Two queries."""
    more = MeasurementSession.objects.values_list("pk", "front__document", "driver", "samples")
    key, document, driver, samples = more.get(uuid=session.uuid)
    protocol = decoded(document).protocol
    runs = Run.objects.filter(session=key).select_related("configuration", "frames").order_by("order")
    return SessionDetail(
        session=session,
        protocol=protocol,
        driver=driver,
        samples=samples,
        runs=tuple(_series(each, session, protocol) for each in runs),
    )


def _series(row: Run, session: SessionRow, protocol: Protocol) -> RunSeries:
    series = packing.decompress(row.frames.content)
    tracked = tuple(packing.unpack_tracked(series.tracked))
    counted = tracked[protocol.first_counted_frame :]
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
        first_counted=protocol.first_counted_frame,
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
