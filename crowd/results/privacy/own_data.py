"""All stored data of one installation, for the participant. It is streamed, since it can be large.

Fields that are renamed, packed or in another table are listed here. All other fields follow by their own
names, including those that a later version adds.
"""

import json
from collections.abc import Iterable, Iterator
from typing import Any

import msgspec
from django.db.models import Model, Prefetch

from crowd.devices.disclosure import public_device
from crowd.devices.models import Installation
from crowd.results.intake import packing
from crowd.results.models import Decision, MeasurementSession, Run, SessionSummary, Submission

CHUNK_SESSIONS = 20
# Only digests of tokens are stored. They are left out: the participant has the token.
TOKEN_FIELDS = ("token_sha256", "next_token_sha256")


def own_data(installation: Installation) -> Iterator[bytes]:
    """A JSON document of all stored data of `installation`, in chunks. Times are microseconds, as sent."""
    sessions = (
        installation.sessions.select_related("front", "device", "description__model")
        .defer("front__document", "front__sequence")
        .prefetch_related(
            Prefetch("runs", Run.objects.select_related("configuration", "frames")),
            "summaries__configuration",
            "summaries__baseline",
            "decisions__run",
        )
        .order_by("pk")
        .iterator(chunk_size=CHUNK_SESSIONS)
    )
    submissions = installation.submissions.order_by("received_at").iterator()
    yield b'{"installation":' + msgspec.json.encode(_other_fields(installation, *TOKEN_FIELDS, "description"))
    yield from _list("submissions", map(_submission, submissions))
    yield from _list("sessions", map(_session, sessions))
    assignments = installation.assignments.select_related("configuration__front")
    assignments = assignments.defer("configuration__front__document", "configuration__front__sequence")
    yield from _list("assignments", map(_assignment, assignments.order_by("pk").iterator()))
    yield b"}"


def _list(name: str, documents: Iterable[dict[str, Any]]) -> Iterator[bytes]:
    yield f',"{name}":['.encode()
    before = b"\n"
    for document in documents:
        yield before + msgspec.json.encode(document)
        before = b",\n"
    yield b"]"


def _submission(submission: Submission) -> dict[str, Any]:
    return _other_fields(submission, "installation", "answer") | {"answer": json.loads(submission.answer)}


def _session(session: MeasurementSession) -> dict[str, Any]:
    description = session.description
    handled = ("id", "uuid", "installation", "submission", "description", "device", "front")
    return {
        "id": session.uuid,
        "submission_id": session.submission_id,
        "application": session.front.application,
        "front_version": session.front.slug,
        "device": description.raw,
        "device_first_seen_at": description.first_seen_at,
        "device_model": str(description.model),
        "public_device": public_device(session.device).slug,
        **_other_fields(session, *handled),
        "runs": [_run(run) for run in session.runs.all()],
        "summaries": [_summary(summary) for summary in session.summaries.all()],
        "decisions": [_decision(decision) for decision in session.decisions.all()],
    }


def _run(run: Run) -> dict[str, Any]:
    series = packing.decompress(run.frames.content)
    stages = packing.unpack_stages(series.stages, series.stages_us)
    handled = ("id", "uuid", "session", "configuration", "failure", "trajectory_sha256", "reason")
    return {
        "id": run.uuid,
        "configuration": run.configuration.name,
        "failure": run.failure or None,
        "frame_us": packing.unpack(series.frame_us).tolist(),
        "stages_us": {name: times.tolist() for name, times in stages.items()},
        "tracked": packing.unpack_tracked(series.tracked) or run.tracked_frames,
        "reason": run.reason or None,
        **({"trajectory_sha256": run.trajectory_sha256} if run.trajectory_sha256 else {}),
        **_other_fields(run, *handled),
    }


def _summary(summary: SessionSummary) -> dict[str, Any]:
    return {
        "configuration": summary.configuration.name,
        "baseline": summary.baseline.name,
        **_other_fields(summary, "id", "session", "installation", "configuration", "baseline"),
    }


def _assignment(assignment: Model) -> dict[str, Any]:
    """What the installation was asked to measure. The model is in crowd.predictions, a layer above."""
    configuration = assignment.configuration  # type: ignore[attr-defined]
    return {
        "front_version": configuration.front.slug,
        "configuration": configuration.name,
        **_other_fields(assignment, "id", "installation", "configuration", "request"),
    }


def _decision(decision: Decision) -> dict[str, Any]:
    """A decision of an administrator, without the administrator's name."""
    return {
        "run": decision.run and decision.run.uuid,
        **_other_fields(decision, "id", "session", "run", "actor"),
    }


def _other_fields(row: Model, *handled: str) -> dict[str, Any]:
    """The fields of `row` by name, except `handled`."""
    fields = (field for field in row._meta.concrete_fields if field.name not in handled)
    return {field.attname: getattr(row, field.attname) for field in fields}
