"""Sessions become summaries, summaries become the published figures. Everything here can be run again at
any time.
"""

from collections import defaultdict
from itertools import pairwise
from typing import Any

from django.db import transaction
from django.db.models import Q, QuerySet
from django.utils import timezone

from crowd.devices.models import DeviceModel
from crowd.fronts.selectors import DEFAULT
from crowd.results import packing, statistics, summaries
from crowd.results.checks import Protocol
from crowd.results.models import (
    DeviceSpeedup,
    MeasurementSession,
    Run,
    SessionSummary,
    State,
    WorkerPulse,
)


def waiting() -> QuerySet[MeasurementSession]:
    """Sessions that the present statistics have not seen: new ones, and all after a change of algorithm."""
    return MeasurementSession.objects.filter(
        Q(summary_algorithm=None) | Q(summary_algorithm__lt=statistics.ALGORITHM)
    ).order_by("id")


def summarise_waiting(limit: int | None = None) -> int:
    """Summarise sessions that wait, oldest first, at most LIMIT; how many there were."""
    keys = list(waiting().values_list("pk", flat=True)[:limit])
    for key in keys:
        summarise_session(key)
    return len(keys)


def pulse(task: str) -> None:
    """Note that TASK ran now."""
    WorkerPulse.objects.update_or_create(task=task, defaults={"at": timezone.now()})


@transaction.atomic
def summarise_session(key: int) -> None:
    """Compute the session's summaries and its device's figures; nothing for a session that is gone."""
    session = MeasurementSession.objects.select_related("front").filter(pk=key).first()
    if session is None:
        return
    # One writer for a device at a time: each must see the other's sessions.
    DeviceModel.objects.select_for_update().get(pk=session.device_id)
    SessionSummary.objects.filter(session=session).delete()
    SessionSummary.objects.bulk_create(_summaries(session))
    MeasurementSession.objects.filter(pk=session.pk).update(summary_algorithm=statistics.ALGORITHM)
    refresh_figures(session.device_id, session.front_id, session.backend, session.processor)


def refresh_figures(device: int, front: int, backend: str, processor: str) -> None:
    """Compute the figures of one model, front, backend and processor anew; those without sessions go."""
    group: dict[str, Any] = {
        "device_id": device,
        "front_id": front,
        "backend": backend,
        "processor": processor,
    }
    found = summaries.figures(SessionSummary.objects.filter(**{f"session__{k}": v for k, v in group.items()}))
    stale = DeviceSpeedup.objects.filter(**group)
    stale.exclude(configuration_id__in=[key.configuration for key in found]).delete()
    for key, figure in found.items():
        model = figure.model
        DeviceSpeedup.objects.update_or_create(
            **group,
            configuration_id=key.configuration,
            defaults={
                "baseline_id": key.baseline,
                "algorithm": statistics.ALGORITHM,
                "speedup": model.speedup.value,
                "low": model.speedup.low,
                "high": model.speedup.high,
                "repeat_low": model.repeat.low if model.repeat else None,
                "repeat_high": model.repeat.high if model.repeat else None,
                "sessions": model.sessions,
                "installations": model.installations,
                "ate_max": figure.ate_max,
                "state": figure.state,
                "last_session_at": figure.last_session_at,
            },
        )


def _summaries(session: MeasurementSession) -> list[SessionSummary]:
    """One summary for every configuration but the baseline; none where the baseline did not run at all."""
    first = Protocol.of(session.front.protocol).first_counted_frame
    by_configuration: dict[int, list[Run]] = defaultdict(list)
    baseline_id = None
    for run in session.runs.select_related("configuration").order_by("repeat"):
        by_configuration[run.configuration_id].append(run)
        if run.configuration.name == DEFAULT:
            baseline_id = run.configuration_id
    if baseline_id is None:
        return []
    baseline = by_configuration.pop(baseline_id)
    return [
        _summary(session, key, candidate, baseline_id, baseline, first)
        for key, candidate in by_configuration.items()
    ]


def _summary(
    session: MeasurementSession,
    candidate_id: int,
    candidate: list[Run],
    baseline_id: int,
    baseline: list[Run],
    first_counted_frame: int,
) -> SessionSummary:
    ratios = statistics.paired_log_ratios(_values(baseline), _values(candidate))
    drifts = [
        value
        for runs in (baseline, candidate)
        for earlier, later in pairwise(run for run in runs if run.mean_us)
        if (value := _drift(earlier, later, first_counted_frame)) is not None
    ]
    drift = max(drifts, default=None)
    state, reason = _state(len(ratios), drift, [*candidate, *baseline])
    return SessionSummary(
        session=session,
        configuration_id=candidate_id,
        baseline_id=baseline_id,
        algorithm=statistics.ALGORITHM,
        log_ratio=float(ratios.mean()) if len(ratios) else None,
        pairs=len(ratios),
        drift=drift,
        ate_max=max((run.ate_max for run in candidate if run.ate_max is not None), default=None),
        state=state,
        reason=reason,
    )


def _values(runs: list[Run]) -> dict[int, float]:
    """Mean microseconds by repeat, of the runs that count."""
    return {run.repeat: run.mean_us for run in runs if run.mean_us and run.state != State.INVALID}


def _drift(earlier: Run, later: Run, first_counted_frame: int) -> float | None:
    return statistics.drift(
        packing.unpack(earlier.frame_us), packing.unpack(later.frame_us), first_counted_frame
    )


def _state(pairs: int, drift: float | None, runs: list[Run]) -> tuple[State, str]:
    if not pairs:
        return State.INVALID, next((run.reason for run in runs if run.state == State.INVALID), "no_pair")
    if drift is not None and drift > statistics.MAX_DRIFT:
        return State.SUSPECT, "drift"
    suspect = next((run.reason for run in runs if run.state == State.SUSPECT), None)
    return (State.VALID, "") if suspect is None else (State.SUSPECT, suspect)
