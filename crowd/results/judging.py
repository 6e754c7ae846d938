"""Whether a run counts, and what else is derived of it: its value and its fingerprint."""

import hashlib
from collections import defaultdict
from collections.abc import Sequence
from uuid import UUID

import numpy as np
from django.db import connection
from django.db.models import F
from numpy.typing import NDArray

from crowd.results import packing, rules, statistics
from crowd.results.checks import Protocol
from crowd.results.decisions import Decisions
from crowd.results.models import Decision, MeasurementSession, Run, State
from crowd.results.rules import Rule

DERIVED = ("mean_us", "fingerprint", "state", "reason")


def judge(run: Run, protocol: Protocol) -> None:
    """Fill RUN's derived columns from what was sent with it; nothing is stored."""
    frames = packing.unpack(run.frame_us)
    first = protocol.first_counted_frame
    run.mean_us = statistics.run_value(frames, first) if frames.size > first else None
    run.fingerprint = fingerprint(frames)
    _set(run, _broken(run, frames, protocol))


def judge_runs(sessions: Sequence[MeasurementSession], decisions: Decisions) -> dict[int, list[Run]]:
    """The runs of SESSIONS by the session's key and repeat, judged by all rules on runs and by DECISIONS.

    Stored where that changes anything. Three queries at most.
    """
    by_key = {session.pk: session for session in sessions}
    protocols = {session.front_id: Protocol.of(session.front.protocol) for session in sessions}
    # A run of another front has nothing to be compared with.
    own = Run.objects.filter(session__in=sessions, configuration__front=F("session__front"))
    rows = own.defer("uuid", "failure", "tracked", "extra")
    runs = list(rows.order_by("session_id", "repeat", "pk"))
    before = {run.pk: _derived(run) for run in runs}
    for run in runs:
        judge(run, protocols[by_key[run.session_id].front_id])
    copies = _copies(runs, {key: session.installation_id for key, session in by_key.items()})
    judged: dict[int, list[Run]] = defaultdict(list)
    for run in runs:
        if run.pk in copies and run.state != State.INVALID:
            _set(run, rules.IDENTICAL_SERIES)
        action = decisions.on_run(run)
        if action == Decision.Action.QUARANTINE:
            _set(run, rules.MODERATED)
        elif action == Decision.Action.RELEASE and run.state in {State.SUSPECT, State.QUARANTINED}:
            _set(run, rules.RELEASED)
        judged[run.session_id].append(run)
    changed = [run for run in runs if before[run.pk] != _derived(run)]
    _store(changed)
    return judged


def _store(runs: Sequence[Run]) -> None:
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


def fingerprint(frames: NDArray[np.uint32]) -> int | None:
    """64 bits of the SHA-256 of the times; None where they are too few, or too alike, to be nobody else's.

    A coarse clock gives many devices the same few values.
    """
    if np.unique(frames).size < statistics.LEAST_DISTINCT_TIMES:
        return None
    digest = hashlib.sha256(frames.tobytes()).digest()
    return int.from_bytes(digest[:8], "big", signed=True)


def _set(run: Run, rule: Rule | None) -> None:
    run.state, run.reason = (State.VALID, "") if rule is None else (rule.state, rule.code)


def _derived(run: Run) -> tuple[float | None, int | None, str, str]:
    """The values of DERIVED."""
    return run.mean_us, run.fingerprint, str(run.state), run.reason


def _broken(run: Run, frames: NDArray[np.uint32], protocol: Protocol) -> Rule | None:
    """The first rule that RUN breaks by itself."""
    if run.status == Run.Status.FAILED:
        return rules.FAILED
    if frames.size != protocol.frames or run.mean_us is None:
        return rules.FRAME_COUNT
    if run.ate_max is None:
        return rules.ATE_MISSING
    if run.ate_max >= protocol.max_ate:
        return rules.ATE_ABOVE_LIMIT
    if run.mean_us < statistics.SHORTEST_MEAN_US:
        return rules.IMPLAUSIBLE_TIME
    if not run.trajectory_sha256:
        return rules.TRAJECTORY_MISSING
    if statistics.stages_exceed_frames(frames, packing.unpack_stages(run.stages, run.stages_us)):
        return rules.STAGES_EXCEED_FRAMES
    return None


def _copies(runs: Sequence[Run], installations: dict[int, UUID]) -> set[int]:
    """Keys of the RUNS whose times another installation sent before; INSTALLATIONS by the session's key."""
    fingerprints = {run.fingerprint for run in runs if run.fingerprint is not None}
    known = Run.objects.filter(fingerprint__in=fingerprints).order_by("-pk")
    # The earliest comes last, and is what remains.
    first = dict(known.values_list("fingerprint", "session__installation_id"))
    return {
        run.pk
        for run in runs
        if run.fingerprint in first and first[run.fingerprint] != installations[run.session_id]
    }
