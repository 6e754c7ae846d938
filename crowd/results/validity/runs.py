"""First step: judge stored runs. Decides whether each counts; computes its mean time and fingerprint.

Runs of the same shape are judged together, as arrays. Times are whole microseconds, so that sums are exact in
any order: the batch does not change the result.
"""

import hashlib
from collections import defaultdict
from collections.abc import Collection, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from uuid import UUID

import numpy as np
from django.db import connection
from django.db.models import Count
from numpy.typing import NDArray

from crowd.results.intake import packing
from crowd.results.models import Decision, MeasurementSession, Run, State
from crowd.results.validity import measures, rules, version
from crowd.results.validity.decisions import Decisions
from crowd.results.validity.rules import Rule
from wire.front import Protocol
from wire.protocol import PROBE_PAIRS, SHORTEST_FRAME_US, SKIPPED_TOLERANCE

DERIVED_COLUMNS = ("mean_us", "fingerprint", "state", "reason")
# A copy has one of these reasons, unless it is invalid.
KNOWN_COPIES = [rule.code for rule in (rules.IDENTICAL_SERIES, rules.MODERATED, rules.RELEASED)]


@dataclass(slots=True)
class StoredRun:
    """The series of a run and its READ_COLUMNS, cheaper than a model instance."""

    series: packing.Series
    pk: int
    session_id: int
    configuration_id: int
    repeat: int
    order: int
    status: str
    ate_max: float | None
    deviation: float | None
    cpu_us: int | None
    waited_us: int | None
    mean_us: float | None
    fingerprint: int | None
    state: str
    reason: str


READ_COLUMNS = [field.name for field in fields(StoredRun)][1:]


@dataclass(frozen=True)
class Front:
    """The parts of a front version that runs are judged by. Configurations are primary keys.

    `order` contains the configurations that every session measures. `skipped`: the share of the counted
    frames that a configuration left out on the reference, for those that leave out any.
    """

    key: int
    protocol: Protocol
    configurations: Collection[int]
    baseline: int | None  # the default configuration
    bands: Mapping[int, float] = field(default_factory=dict)
    order: Collection[int] = ()
    skipped: Mapping[int, float] = field(default_factory=dict)

    def planned_repeats(self, configuration: int) -> int:
        """The pairs of `configuration` that a session needs: fewer of one that not every session measures."""
        most = self.protocol.repeats
        return most if configuration in self.order else min(most, PROBE_PAIRS)


@dataclass(frozen=True)
class SessionContext:
    """The parts of a session that its runs are judged by."""

    installation: UUID
    front: Front


def judge_runs(sessions: Mapping[int, SessionContext], decisions: Decisions) -> dict[int, list[StoredRun]]:
    """The runs of `sessions` by the session's key, in the order of their repeats, judged by all rules on runs
    and by `decisions`.

    Stored where that changes anything. Four queries at most.
    """
    stored = Run.objects.filter(session__in=sessions.keys()).order_by()
    rows = stored.values_list("frames__content", *READ_COLUMNS)
    runs = [
        run
        for run in (StoredRun(packing.decompress(content), *row) for content, *row in rows)
        # A run of another front cannot be compared with any of this one.
        if run.configuration_id in sessions[run.session_id].front.configurations
    ]
    # Not by the database, which would carry the times along.
    runs.sort(key=lambda run: (run.session_id, run.repeat, run.pk))
    before = [_derived_values(run) for run in runs]
    judge_alone(runs, sessions)
    copies = _copied_runs(runs, sessions)
    judged: dict[int, list[StoredRun]] = defaultdict(list)
    for run in runs:
        if run.pk in copies and run.state != State.INVALID:
            _apply_rule(run, rules.IDENTICAL_SERIES)
        action = decisions.on_run(run)
        if action == Decision.Action.QUARANTINE:
            _apply_rule(run, rules.MODERATED)
        elif action == Decision.Action.RELEASE and run.state in {State.SUSPECT, State.QUARANTINED}:
            _apply_rule(run, rules.RELEASED)
        judged[run.session_id].append(run)
    _store([run for run, was in zip(runs, before, strict=True) if was != _derived_values(run)])
    return judged


def judge_alone(runs: Iterable[StoredRun], sessions: Mapping[int, SessionContext]) -> None:
    """Judge each of `runs` by itself, together with those of the same front, frames and stages."""
    same: dict[Hashable, list[StoredRun]] = defaultdict(list)
    for run in runs:
        series = run.series
        shape = len(series.frame_us), tuple(series.stages), len(series.stages_us)
        same[sessions[run.session_id].front.key, *shape].append(run)
    for group in same.values():
        _judge_batch(group, sessions[group[0].session_id].front)


def _judge_batch(runs: Sequence[StoredRun], front: Front) -> None:
    """`runs` have the same front, the same number of frames and the same stages."""
    frames = packing.unpack_many([run.series.frame_us for run in runs])
    first, size = front.protocol.first_counted_frame, frames.shape[1]
    means = measures.mean_times(frames, first).tolist() if size > first else [None] * len(runs)
    distinct = measures.distinct_times(frames) >= measures.LEAST_DISTINCT_TIMES
    names = runs[0].series.stages
    stages = packing.unpack_many([run.series.stages_us for run in runs]) if names else frames[:, :0]
    exceeding = measures.stages_exceed_frames(frames, names, stages)
    left_out = _skipped_frames(runs, size, front)
    skipped = measures.skipped_shares(left_out, first).tolist()
    longer = measures.skipped_take_longer(frames, left_out, first)
    for run, mean, enough, exceeds, share, is_longer in zip(
        runs, means, distinct.tolist(), exceeding.tolist(), skipped, longer.tolist(), strict=True
    ):
        run.mean_us = mean
        run.fingerprint = fingerprint(run.series.frame_us) if enough else None
        suspicions = {
            rules.SKIPPED_SHARE: not _skips_as_reference(run, share, front),
            rules.SKIPPED_TIMES: is_longer,
            rules.STAGES_EXCEED_FRAMES: exceeds,
        }
        suspicion = next((rule for rule, applies in suspicions.items() if applies), None)
        _apply_rule(run, _violated_rule(run, size, share, front) or suspicion)


def _skipped_frames(runs: Sequence[StoredRun], size: int, front: Front) -> NDArray[np.bool_]:
    """The frames that each run left out, (runs, size).

    Those without a report of tracking, of configurations that leave out frames. Others compute such a frame:
    they only do not track there.
    """
    told = [
        tracked if run.configuration_id in front.skipped and len(tracked) == size else bytes(size)
        for run in runs
        for tracked in [run.series.tracked]
    ]
    skipped: NDArray[np.bool_] = (
        np.frombuffer(b"".join(told), np.uint8).reshape(len(runs), size) == packing.NEITHER
    )
    return skipped


def _skips_as_reference(run: StoredRun, share: float, front: Front) -> bool:
    reference = front.skipped.get(run.configuration_id)
    return reference is None or abs(share - reference) <= SKIPPED_TOLERANCE


def _store(runs: Sequence[StoredRun]) -> None:
    """Store the derived columns of `runs`, with one prepared statement.

    Django's bulk_update has a CASE for each row and column and takes ten times as long.
    """
    if not runs:
        return
    table = connection.ops.quote_name(Run._meta.db_table)
    columns = ", ".join(f"{connection.ops.quote_name(name)} = %s" for name in DERIVED_COLUMNS)
    with connection.cursor() as cursor:
        cursor.executemany(
            f"UPDATE {table} SET {columns} WHERE id = %s", [(*_derived_values(run), run.pk) for run in runs]
        )


def fingerprint(frame_us: bytes | memoryview) -> int:
    """64 bits of the SHA-256 of the packed times.

    Only useful for times that vary: a coarse clock gives many devices the same few values.
    """
    return int.from_bytes(hashlib.sha256(frame_us).digest()[:8], "big", signed=True)


def _apply_rule(run: StoredRun, rule: Rule | None) -> None:
    run.state, run.reason = (State.VALID, "") if rule is None else (rule.state, rule.code)


def _derived_values(run: StoredRun) -> tuple[float | None, int | None, str, str]:
    """The values of `run` for DERIVED_COLUMNS."""
    return run.mean_us, run.fingerprint, str(run.state), run.reason


def _violated_rule(run: StoredRun, frames: int, skipped: float, front: Front) -> Rule | None:
    """The first rule that makes `run` invalid, with so many `frames`, of which it left out the share
    `skipped`."""
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
    if run.mean_us < SHORTEST_FRAME_US * (1 - skipped) or skipped == 1:
        return rules.IMPLAUSIBLE_TIME
    return None


def _copied_runs(runs: Iterable[StoredRun], sessions: Mapping[int, SessionContext]) -> set[int]:
    """Keys of the `runs` whose times another installation sent before. At most two queries."""
    marked = {run.pk: run for run in runs if run.fingerprint is not None}
    sent_before = Run.objects.filter(fingerprint__in={run.fingerprint for run in marked.values()}).order_by()
    # Read from the index. Usually only the run itself is there.
    same: dict[int | None, set[int]] = defaultdict(set)
    for key, run in marked.items():
        same[run.fingerprint].add(key)
    for value, key in sent_before.values_list("fingerprint", "pk"):
        same[value].add(key)
    elsewhere = [key for keys in same.values() for key in keys if key not in marked]
    installations = {key: sessions[run.session_id].installation for key, run in marked.items()}
    if elsewhere:
        others = Run.objects.filter(pk__in=elsewhere).order_by()
        installations.update(others.values_list("pk", "session__installation_id"))
    return _copies(same.values(), installations) & marked.keys()


def _copies(same: Iterable[Collection[int]], installations: Mapping[int, UUID]) -> set[int]:
    """Keys of runs with the times of another installation's earlier one; each of `same` has equal times."""
    copies = set()
    for keys in same:
        first = installations[min(keys)]
        copies |= {key for key in keys if installations[key] != first}
    return copies


def mark_missed_copies(sessions: Collection[int]) -> None:
    """Mark for a new summary those copies, of runs of `sessions` or in them, that were not judged as copies.

    They were judged before their original, or at the same time: neither transaction saw the other's run. So
    this is called after the commit, when the later one sees both.
    """
    times = Run.objects.filter(session__in=sessions, fingerprint__isnull=False).order_by()
    several = (
        # As values, so that PostgreSQL reads the index and not all runs.
        Run.objects.filter(fingerprint__in=set(times.values_list("fingerprint", flat=True)))
        .order_by()
        .values_list("fingerprint")
        .annotate(count=Count("*"))
        .filter(count__gt=1)
    )
    if not (values := [value for value, _ in several]):
        return
    same: dict[int | None, set[int]] = defaultdict(set)
    installations = {}
    rows = Run.objects.filter(fingerprint__in=values).order_by()
    for value, key, installation in rows.values_list("fingerprint", "pk", "session__installation_id"):
        same[value].add(key)
        installations[key] = installation
    missed = (
        Run.objects.filter(pk__in=_copies(same.values(), installations))
        .exclude(state__in=[State.PENDING, State.INVALID])
        .exclude(reason__in=KNOWN_COPIES)
        .order_by()
    )
    waiting = MeasurementSession.objects.filter(pk__in=missed.values("session"))
    waiting.update(summary_algorithm=version.OUTDATED)
