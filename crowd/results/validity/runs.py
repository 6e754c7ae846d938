"""The first step, from stored runs to judged ones: whether each counts, its mean time and its fingerprint.

Runs of one shape are judged at once, as arrays. Times are whole microseconds, whose sums are exact in any
order: a run is judged alike, alone or among many.
"""

import hashlib
from collections import defaultdict
from collections.abc import Collection, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from uuid import UUID

from django.db import connection

from crowd.results.intake import packing
from crowd.results.intake.checks import Protocol
from crowd.results.models import Decision, MeasurementSession, Run, State
from crowd.results.validity import measures, rules, version
from crowd.results.validity.decisions import Decisions
from crowd.results.validity.rules import Rule
from slam.protocol import PROBE_PAIRS

DERIVED = ("mean_us", "fingerprint", "state", "reason")
READ = (
    "pk", "session_id", "configuration_id", "repeat", "order", "status", "frame_us", "stages", "stages_us",
    "ate_max", "trajectory_sha256", "deviation", *DERIVED,
)  # fmt: skip


@dataclass(slots=True)
class StoredRun:
    """The columns READ of a run, without the cost of a model instance."""

    pk: int
    session_id: int
    configuration_id: int
    repeat: int
    order: int
    status: str
    frame_us: bytes
    stages: list[str]
    stages_us: bytes
    ate_max: float | None
    trajectory_sha256: str
    deviation: float | None
    mean_us: float | None
    fingerprint: int | None
    state: str
    reason: str


@dataclass(frozen=True)
class Front:
    """The parts of a front version by which runs are judged and compared; configurations by their keys.

    `bands` (m) has those of protocol 2. `order` are the configurations that every session measures.
    """

    key: int
    protocol: Protocol
    configurations: Collection[int]
    baseline: int | None  # the default configuration
    bands: Mapping[int, float] = field(default_factory=dict)
    order: Collection[int] = ()

    def planned_repeats(self, configuration: int) -> int:
        """How many pairs a session needs of CONFIGURATION: fewer of one that not every session measures."""
        most = self.protocol.repeats
        return most if configuration in self.order else min(most, PROBE_PAIRS)


@dataclass(frozen=True)
class SessionContext:
    """The parts of a session by which its runs are judged."""

    installation: UUID
    front: Front


def judge_runs(sessions: Mapping[int, SessionContext], decisions: Decisions) -> dict[int, list[StoredRun]]:
    """The runs of SESSIONS by the session's key, in the order of their repeats, judged by all rules on runs
    and by DECISIONS.

    Stored where that changes anything. Four queries at most.
    """
    rows = Run.objects.filter(session__in=sessions.keys()).order_by().values_list(*READ)
    runs = [
        run
        for run in (StoredRun(*row) for row in rows)
        # A run of another front cannot be compared with any of this one.
        if run.configuration_id in sessions[run.session_id].front.configurations
    ]
    # Not by the database, which would carry the times along.
    runs.sort(key=lambda run: (run.session_id, run.repeat, run.pk))
    before = [_derived(run) for run in runs]
    _judge_all(runs, sessions)
    copies = _copies(runs, sessions)
    judged: dict[int, list[StoredRun]] = defaultdict(list)
    for run in runs:
        if run.pk in copies and run.state != State.INVALID:
            _set(run, rules.IDENTICAL_SERIES)
        action = decisions.on_run(run)
        if action == Decision.Action.QUARANTINE:
            _set(run, rules.MODERATED)
        elif action == Decision.Action.RELEASE and run.state in {State.SUSPECT, State.QUARANTINED}:
            _set(run, rules.RELEASED)
        judged[run.session_id].append(run)
    _store([run for run, was in zip(runs, before, strict=True) if was != _derived(run)])
    return judged


def _judge_all(runs: Iterable[StoredRun], sessions: Mapping[int, SessionContext]) -> None:
    """Judge RUNS of SESSIONS by themselves: those alike in front, frames and stages at once."""
    alike: dict[Hashable, list[StoredRun]] = defaultdict(list)
    for run in runs:
        alike[
            sessions[run.session_id].front.key, len(run.frame_us), tuple(run.stages), len(run.stages_us)
        ].append(run)
    for group in alike.values():
        _judge_alike(group, sessions[group[0].session_id].front)


def _judge_alike(runs: Sequence[StoredRun], front: Front) -> None:
    """RUNS have the same front, the same number of frames and the same stages."""
    frames = packing.unpack_many([run.frame_us for run in runs])
    first, size = front.protocol.first_counted_frame, frames.shape[1]
    means = measures.mean_times(frames, first).tolist() if size > first else [None] * len(runs)
    distinct = measures.distinct_times(frames) >= measures.LEAST_DISTINCT_TIMES
    names = runs[0].stages
    stages = packing.unpack_many([run.stages_us for run in runs]) if names else frames[:, :0]
    exceeding = measures.stages_exceed_frames(frames, names, stages)
    for run, mean, enough, exceeds in zip(runs, means, distinct.tolist(), exceeding.tolist(), strict=True):
        run.mean_us = mean
        run.fingerprint = fingerprint(run.frame_us) if enough else None
        _set(run, _broken(run, size, front) or (rules.STAGES_EXCEED_FRAMES if exceeds else None))


def _store(runs: Sequence[StoredRun]) -> None:
    """Write the derived columns of RUNS. One statement for each, prepared once: a single one with a case for
    each row and column, as Django writes it, takes ten times as long.
    """
    if not runs:
        return
    table = connection.ops.quote_name(Run._meta.db_table)
    columns = ", ".join(f"{connection.ops.quote_name(name)} = %s" for name in DERIVED)
    with connection.cursor() as cursor:
        cursor.executemany(
            f"UPDATE {table} SET {columns} WHERE id = %s", [(*_derived(run), run.pk) for run in runs]
        )


def fingerprint(frame_us: bytes | memoryview) -> int:
    """64 bits of the SHA-256 of the packed times. Only for times that vary enough: a coarse clock gives many
    devices the same few values.
    """
    return int.from_bytes(hashlib.sha256(frame_us).digest()[:8], "big", signed=True)


def _set(run: StoredRun, rule: Rule | None) -> None:
    run.state, run.reason = (State.VALID, "") if rule is None else (rule.state, rule.code)


def _derived(run: StoredRun) -> tuple[float | None, int | None, str, str]:
    """The values of DERIVED."""
    return run.mean_us, run.fingerprint, str(run.state), run.reason


def _broken(run: StoredRun, frames: int, front: Front) -> Rule | None:
    """The first rule that RUN, of so many FRAMES, breaks by itself, except the last one, on stages."""
    protocol, band = front.protocol, front.bands.get(run.configuration_id)
    if run.status == Run.Status.FAILED:
        return rules.FAILED
    if frames != protocol.frames or run.mean_us is None:
        return rules.FRAME_COUNT
    if run.ate_max is None:
        return rules.ATE_MISSING
    if run.ate_max >= protocol.max_ate:
        return rules.ATE_ABOVE_LIMIT
    if band is not None and run.deviation is not None and run.deviation > band:
        return rules.DEVIATION_ABOVE_BAND
    if run.mean_us < measures.SHORTEST_MEAN_US:
        return rules.IMPLAUSIBLE_TIME
    if not run.trajectory_sha256 and run.deviation is None:
        return rules.TRAJECTORY_MISSING
    return None


def _copies(runs: Iterable[StoredRun], sessions: Mapping[int, SessionContext]) -> set[int]:
    """Keys of the RUNS whose times another installation sent before. Two queries at most.

    Where such a copy was judged before the run that it copies, its session is marked for another summary.
    """
    marked = {run.pk: run for run in runs if run.fingerprint is not None}
    known = Run.objects.filter(fingerprint__in={run.fingerprint for run in marked.values()}).order_by()
    # From the index alone; nearly always there is nothing but the run itself.
    alike: dict[int | None, set[int]] = defaultdict(set)
    for key, run in marked.items():
        alike[run.fingerprint].add(key)
    for value, key in known.values_list("fingerprint", "pk"):
        alike[value].add(key)
    elsewhere = [key for keys in alike.values() for key in keys if key not in marked]
    installations = {key: sessions[run.session_id].installation for key, run in marked.items()}
    if elsewhere:
        others = Run.objects.filter(pk__in=elsewhere).order_by()
        installations.update(others.values_list("pk", "session__installation_id"))
    copies = {
        key for keys in alike.values() for key in keys if installations[key] != installations[min(keys)]
    }
    if missed := copies - marked.keys():
        unseen = Run.objects.filter(pk__in=missed).exclude(reason=rules.IDENTICAL_SERIES.code)
        waiting = MeasurementSession.objects.filter(
            pk__in=unseen.exclude(state=State.PENDING).values("session")
        )
        waiting.update(summary_algorithm=version.AGAIN)
    return copies & marked.keys()
