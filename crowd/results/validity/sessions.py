"""Sessions' answers: each configuration's runs against those of the baseline."""

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any
from uuid import UUID

from crowd.results.figures import statistics
from crowd.results.intake import packing
from crowd.results.models import SessionSummary, State
from crowd.results.validity import rules
from crowd.results.validity.rules import Rule
from crowd.results.validity.runs import StoredRun

HIDDEN = frozenset({State.INVALID, State.QUARANTINED})

# Configuration -> drift of its runs; a configuration that was not repeated has none.
Drifts = Mapping[int, float | None]


@dataclass(frozen=True)
class SessionInput:
    """What of a session its answers rest on, besides its runs; `baseline` is the key of a configuration.
    `released`: an administrator lets it count. `clock_mhz`: the readings, of a session whose runs drift.
    """

    key: int
    cohort: int
    installation: UUID
    started_at: datetime
    baseline: int | None
    emulated: bool
    released: bool
    clock_mhz: Sequence[float]


def summaries(session: SessionInput, runs: Iterable[StoredRun], drifts: Drifts) -> list[SessionSummary]:
    """One summary for every configuration but the baseline; none where the baseline did not run.

    RUNS are judged and in order of their repeats, DRIFTS theirs. A released session counts where it has a
    pair of runs at all. Nothing is stored.
    """
    by_configuration = _by_configuration(runs)
    if session.baseline is None or session.baseline not in by_configuration:
        return []
    against = by_configuration.pop(session.baseline)
    started_at = session.started_at.astimezone(UTC)
    return [
        SessionSummary(
            cohort_id=session.cohort,
            installation_id=session.installation,
            session_id=session.key,
            configuration_id=key,
            baseline_id=session.baseline,
            algorithm=statistics.ALGORITHM,
            started_at=started_at,
            day=started_at.date(),
            counted=True,  # until its day's sessions are counted
            ate_max=max((run.ate_max for run in candidate if run.ate_max is not None), default=None),
            **_answer(session, candidate, against, [drifts.get(key), drifts.get(session.baseline)]),
        )
        for key, candidate in by_configuration.items()
    ]


def drifts(
    sessions: Mapping[int, Iterable[StoredRun]], first_counted_frames: Mapping[int, int]
) -> dict[int, dict[int, float | None]]:
    """The last repeat of each configuration against its first, of SESSIONS: key -> judged runs in order of
    their repeats. FIRST_COUNTED_FRAMES by the same keys.
    """
    pairs: dict[tuple[int, int], list[tuple[int, int, StoredRun, StoredRun]]] = defaultdict(list)
    for session, runs in sessions.items():
        for configuration, repeats in _by_configuration(runs).items():
            timed = [run for run in repeats if run.mean_us]
            if len(timed) > 1:
                first, last = timed[0], timed[-1]
                frames = min(len(first.frame_us), len(last.frame_us))
                alike = (first_counted_frames[session], frames)
                pairs[alike].append((session, configuration, first, last))
    found: dict[int, dict[int, float | None]] = defaultdict(dict)
    for (first_counted, frames), group in pairs.items():
        values = statistics.drifts(
            packing.unpack_many([first.frame_us[:frames] for _, _, first, _ in group]),
            packing.unpack_many([last.frame_us[:frames] for _, _, _, last in group]),
            first_counted,
        )
        for (session, configuration, _, _), value in zip(group, values, strict=True):
            found[session][configuration] = value
    return found


def drifted(drifts: Drifts) -> bool:
    """Whether one of DRIFTS is too large: then the readings of the clock tell which rule is broken."""
    return any(drift is not None and drift > statistics.MAX_DRIFT for drift in drifts.values())


def _by_configuration(runs: Iterable[StoredRun]) -> dict[int, list[StoredRun]]:
    found: dict[int, list[StoredRun]] = defaultdict(list)
    for run in runs:
        found[run.configuration_id].append(run)
    return found


def _answer(
    session: SessionInput, candidate: list[StoredRun], against: list[StoredRun], drifts: list[float | None]
) -> dict[str, Any]:
    ratios = statistics.paired_log_ratios(_values(against), _values(candidate))
    drift = max((drift for drift in drifts if drift is not None), default=None)
    runs = [*candidate, *against]
    if not len(ratios):
        rule: Rule | None = _without_pair(runs)
    elif session.released:
        rule = rules.RELEASED
    else:
        rule = _broken(session, {run.reason for run in runs}, drift)
    return {
        "log_ratio": float(ratios.mean()) if len(ratios) else None,
        "pairs": len(ratios),
        "drift": drift,
        "state": State.VALID if rule is None else rule.state,
        "reason": "" if rule is None else rule.code,
    }


def _values(runs: list[StoredRun]) -> dict[int, float]:
    """Mean microseconds by repeat, of the runs that count."""
    return {run.repeat: run.mean_us for run in runs if run.mean_us and run.state not in HIDDEN}


def _without_pair(runs: list[StoredRun]) -> Rule:
    """Why RUNS give no ratio: what hides one of them, or else the rule that the first of them broke."""
    broken = [rules.RULES[run.reason] for run in runs if run.state in HIDDEN]
    hidden = [rule for rule in broken if rule.state == State.QUARANTINED]
    return next(iter(hidden + broken), rules.NO_PAIR)


def _broken(session: SessionInput, reasons: set[str], drift: float | None) -> Rule | None:
    """The first rule that a session with a ratio breaks; REASONS are those of its runs."""
    if rules.IDENTICAL_SERIES.code in reasons:
        return rules.IDENTICAL_SERIES
    if session.emulated:
        return rules.EMULATOR
    if drift is not None and drift > statistics.MAX_DRIFT:
        return rules.THROTTLING if _clock_fell(session.clock_mhz) else rules.DRIFT
    suspicions = (rule for rule in rules.RULES.values() if rule.state == State.SUSPECT)
    return next((rule for rule in suspicions if rule.code in reasons), None)


def _clock_fell(clock_mhz: Sequence[float]) -> bool:
    fall = statistics.clock_fall(clock_mhz)
    return fall is not None and fall > statistics.MAX_DRIFT
