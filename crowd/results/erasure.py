"""What a participant may ask for: everything that is kept of them, and that it be gone."""

import json
from typing import Any
from uuid import UUID

from django.db import transaction

from crowd.devices.models import DeviceDescription, DeviceModel, Installation
from crowd.results import packing, summarising
from crowd.results.models import MeasurementSession, Run


def own_data(installation: Installation) -> dict[str, Any]:
    """Everything stored of INSTALLATION, times in microseconds as they were sent. Four queries."""
    sessions = installation.sessions.select_related("front", "description").prefetch_related(
        "runs__configuration"
    )
    return {
        "installation": {
            "id": installation.pk,
            "app": installation.app,
            "app_version": installation.app_version,
            "consent_version": installation.consent_version,
            "created_at": installation.created_at,
        },
        "submissions": [
            {
                "id": submission.pk,
                "idempotency_key": submission.idempotency_key,
                "received_at": submission.received_at,
                "app_version": submission.app_version,
                "consent_version": submission.consent_version,
                "answer": json.loads(submission.answer),
            }
            for submission in installation.submissions.all()
        ],
        "sessions": [_session(session) for session in sessions.prefetch_related("runs__configuration")],
    }


def _session(session: MeasurementSession) -> dict[str, Any]:
    return {
        "id": session.uuid,
        "submission_id": session.submission_id,
        "application": session.front.application,
        "front_version": session.front.slug,
        "protocol_version": session.protocol_version,
        "backend": session.backend,
        "device": session.description.raw,
        "started_at": session.started_at,
        "received_at": session.received_at,
        "samples": session.samples,
        "runs": [_run(run) for run in session.runs.all()],
    }


def _run(run: Run) -> dict[str, Any]:
    stages = packing.unpack_stages(run.stages, run.stages_us)
    return {
        "id": run.uuid,
        "configuration": run.configuration.name,
        "repeat": run.repeat,
        "order": run.order,
        "status": run.status,
        "failure": run.failure or None,
        "frame_us": packing.unpack(run.frame_us).tolist(),
        "stages_us": {name: series.tolist() for name, series in stages.items()},
        "tracked": packing.unpack_tracked(run.tracked) or run.tracked_frames,
        "ate_max": run.ate_max,
        "ate_mean": run.ate_mean,
        "ate_rmse": run.ate_rmse,
        "trajectory_sha256": run.trajectory_sha256 or None,
        "state": run.state,
        "reason": run.reason or None,
    }


@transaction.atomic
def erase_installation(installation: Installation) -> None:
    """Delete everything of INSTALLATION and compute the figures that held it anew."""
    sessions = list(installation.sessions.all())
    # Locks in one order, so that two erasures never wait for each other.
    list(DeviceModel.objects.select_for_update().filter(sessions__installation=installation).order_by("pk"))
    installation.delete()
    _after(sessions)


@transaction.atomic
def erase_run(installation: Installation, uuid: UUID) -> bool:
    """Delete one run of INSTALLATION, and its session with the last one; False where there is none."""
    own = Run.objects.filter(session__installation=installation).select_related("session")
    run = own.filter(uuid=uuid).first()
    if run is None:
        return False
    session = run.session
    run.delete()
    if session.runs.exists():
        summarising.summarise_session(session.pk)
    else:
        DeviceModel.objects.select_for_update().get(pk=session.device_id)
        session.delete()
        _after([session])
    return True


def _after(sessions: list[MeasurementSession]) -> None:
    """Figures without the deleted SESSIONS; descriptions and models that nobody's session names go too."""
    for group in {(s.device_id, s.front_id, s.backend, s.processor) for s in sessions}:
        summarising.refresh_figures(*group)
    descriptions = {session.description_id for session in sessions}
    DeviceDescription.objects.filter(pk__in=descriptions, sessions=None).delete()
    models = {session.device_id for session in sessions}
    DeviceModel.objects.filter(pk__in=models, sessions=None, descriptions=None).delete()
