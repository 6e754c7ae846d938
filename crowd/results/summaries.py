"""Session summaries grouped into figures of device models: where sessions become a speedup."""

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import datetime

from django.db.models import QuerySet

from crowd.results import statistics
from crowd.results.models import SessionSummary, State


@dataclass(frozen=True)
class Key:
    """What one figure is about, as primary keys; processor is the OpenCL device's name."""

    front: int
    configuration: int
    baseline: int
    device: int
    backend: str
    processor: str


@dataclass(frozen=True)
class Figure:
    """A device model's speedup with its counts. Suspect when no valid session stands behind it."""

    model: statistics.ModelSpeedup
    ate_max: float | None
    state: State
    last_session_at: datetime


@dataclass(frozen=True)
class _Session:
    installation: object
    started_at: datetime
    log_ratio: float
    ate_max: float | None
    state: str


def figures(summaries: QuerySet[SessionSummary]) -> dict[Key, Figure]:
    """The figure of every key that SUMMARIES hold a usable session of. One query.

    Valid sessions make the figure; suspect ones do only where there is no valid session. Invalid ones never
    count.
    """
    groups: dict[Key, list[_Session]] = defaultdict(list)
    rows = (
        summaries.exclude(log_ratio=None)
        .exclude(state=State.INVALID)
        .order_by("session__started_at", "session_id")
    )
    for (
        front,
        configuration,
        baseline,
        device,
        backend,
        processor,
        who,
        when,
        log_ratio,
        ate,
        state,
    ) in rows.values_list(
        "session__front_id",
        "configuration_id",
        "baseline_id",
        "session__device_id",
        "session__backend",
        "session__processor",
        "session__installation_id",
        "session__started_at",
        "log_ratio",
        "ate_max",
        "state",
    ):
        assert log_ratio is not None  # such rows are left out above
        key = Key(front, configuration, baseline, device, backend, processor)
        groups[key].append(_Session(who, when, log_ratio, ate, state))
    return {key: _figure(sessions) for key, sessions in groups.items()}


def _figure(sessions: Iterable[_Session]) -> Figure:
    sessions = list(sessions)
    valid = [session for session in sessions if session.state == State.VALID]
    counted = valid or sessions
    return Figure(
        model=statistics.model_speedup(
            statistics.SessionValue(session.installation, session.started_at.date(), session.log_ratio)
            for session in counted
        ),
        ate_max=max((session.ate_max for session in counted if session.ate_max is not None), default=None),
        state=State.VALID if valid else State.SUSPECT,
        last_session_at=max(session.started_at for session in counted),
    )
