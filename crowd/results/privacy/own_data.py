"""Everything that is kept of one installation, for the participant: streamed, so that it may be of any size.

What is stored under another name, packed or in another table is named here; every other field follows under
its own name, also one that a later version adds.
"""

import json
from collections.abc import Iterable, Iterator
from typing import Any

import msgspec
from django.db.models import Model

from crowd.devices.disclosure import public_device
from crowd.devices.models import Installation
from crowd.results.intake import packing
from crowd.results.models import Decision, MeasurementSession, Run, SessionSummary, Submission

SESSIONS_AT_ONCE = 20
# Of the tokens only digests are kept: they say nothing, and the participant has the token itself.
TOKENS = ("token_sha256", "next_token_sha256")


def own_data(installation: Installation) -> Iterator[bytes]:
    """A JSON document of all that is stored of INSTALLATION, in pieces; times in microseconds as sent."""
    sessions = (
        installation.sessions.select_related("front", "device", "description__model")
        .prefetch_related(
            "runs__configuration", "summaries__configuration", "summaries__baseline", "decisions__run"
        )
        .order_by("pk")
        .iterator(chunk_size=SESSIONS_AT_ONCE)
    )
    submissions = installation.submissions.order_by("received_at").iterator()
    yield b'{"installation":' + msgspec.json.encode(_rest(installation, *TOKENS, "description"))
    yield from _list("submissions", map(_submission, submissions))
    yield from _list("sessions", map(_session, sessions))
    assignments = installation.assignments.select_related("configuration__front").order_by("pk")
    yield from _list("assignments", map(_assignment, assignments.iterator()))
    yield b"}"


def _list(name: str, documents: Iterable[dict[str, Any]]) -> Iterator[bytes]:
    yield f',"{name}":['.encode()
    before = b"\n"
    for document in documents:
        yield before + msgspec.json.encode(document)
        before = b",\n"
    yield b"]"


def _submission(submission: Submission) -> dict[str, Any]:
    return _rest(submission, "installation", "answer") | {"answer": json.loads(submission.answer)}


def _session(session: MeasurementSession) -> dict[str, Any]:
    description = session.description
    told = ("id", "uuid", "installation", "submission", "description", "device", "front")
    return {
        "id": session.uuid,
        "submission_id": session.submission_id,
        "application": session.front.application,
        "front_version": session.front.slug,
        "device": description.raw,
        "device_first_seen_at": description.first_seen_at,
        "device_model": str(description.model),
        "public_device": public_device(session.device).slug,
        **_rest(session, *told),
        "runs": [_run(run) for run in session.runs.all()],
        "summaries": [_summary(summary) for summary in session.summaries.all()],
        "decisions": [_decision(decision) for decision in session.decisions.all()],
    }


def _run(run: Run) -> dict[str, Any]:
    stages = packing.unpack_stages(run.stages, run.stages_us)
    told = (
        *("id", "uuid", "session", "configuration", "failure", "frame_us", "stages", "stages_us", "tracked"),
        *("trajectory_sha256", "reason"),
    )
    return {
        "id": run.uuid,
        "configuration": run.configuration.name,
        "failure": run.failure or None,
        "frame_us": packing.unpack(run.frame_us).tolist(),
        "stages_us": {name: series.tolist() for name, series in stages.items()},
        "tracked": packing.unpack_tracked(run.tracked) or run.tracked_frames,
        "trajectory_sha256": run.trajectory_sha256 or None,
        "reason": run.reason or None,
        **_rest(run, *told),
    }


def _summary(summary: SessionSummary) -> dict[str, Any]:
    return {
        "configuration": summary.configuration.name,
        "baseline": summary.baseline.name,
        **_rest(summary, "id", "session", "installation", "configuration", "baseline"),
    }


def _assignment(assignment: Model) -> dict[str, Any]:
    """What the installation was asked to measure. The model is of crowd.predictions, a layer above."""
    configuration = assignment.configuration  # type: ignore[attr-defined]
    return {
        "front_version": configuration.front.slug,
        "configuration": configuration.name,
        **_rest(assignment, "id", "installation", "configuration", "request"),
    }


def _decision(decision: Decision) -> dict[str, Any]:
    """Why an administrator hid it or let it count; which one is the name of another person."""
    return {
        "run": decision.run and decision.run.uuid,
        **_rest(decision, "id", "session", "run", "actor"),
    }


def _rest(row: Model, *told: str) -> dict[str, Any]:
    """ROW's fields by their names, but for those TOLD elsewhere."""
    fields = (field for field in row._meta.concrete_fields if field.name not in told)
    return {field.attname: getattr(row, field.attname) for field in fields}
