"""The second step, from judged runs to sessions: each configuration's runs against those of the baseline."""

import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import date, datetime
from typing import Any
from uuid import UUID

from crowd.results.intake import packing
from crowd.results.models import SessionSummary, State
from crowd.results.validity import measures, rules, version
from crowd.results.validity.rules import RULES, Level, Rule
from crowd.results.validity.runs import Front, StoredRun
from slam.protocol import MAX_DRIFT

HIDDEN = frozenset({State.INVALID, State.QUARANTINED})
# Reasons of runs that are reasons of their session, too.
PASSED_ON = frozenset(
    rule.code for rule in RULES.values() if rule.level == Level.RUN and rule.state == State.SUSPECT
) | {rules.IDENTICAL_SERIES.code}

# By session, then by configuration; None where a configuration has no two runs to compare.
Drifts = Mapping[int, Mapping[int, float | None]]
# The readings of the processor's clock (MHz) of the sessions with the given keys.
ReadClocks = Callable[[Sequence[int]], Mapping[int, Sequence[float]]]


@dataclass(frozen=True)
class SessionInput:
    """What the summaries of a session rest on, besides its runs.

    `day`: the server's day (UTC) on which the session counts. `emulated`: its device is an emulator.
    `released`: an administrator lets it count.
    """

    key: int
    cohort: int
    installation: UUID
    started_at: datetime
    day: date
    front: Front
    emulated: bool
    released: bool


def summarise(
    sessions: Sequence[SessionInput], runs: Mapping[int, Sequence[StoredRun]], read_clocks: ReadClocks
) -> list[SessionSummary]:
    """One summary for every configuration of every session but the baseline; none where that did not run.

    RUNS by the session's key: judged, in the order of their repeats. READ_CLOCKS is called once, with the
    keys of the sessions that drift. A released session counts where it has any pair of runs. Nothing is
    stored.
    """
    drifts = _drifts(sessions, runs)
    drifting = [
        key for key, values in drifts.items() if any(measures.has_drifted(value) for value in values.values())
    ]
    clocks = read_clocks(drifting) if drifting else {}
    return [
        summary
        for session in sessions
        for summary in _summaries(
            session, runs.get(session.key, ()), drifts.get(session.key, {}), clocks.get(session.key, ())
        )
    ]


def _drifts(sessions: Iterable[SessionInput], runs: Mapping[int, Sequence[StoredRun]]) -> Drifts:
    """The second half of each configuration's repeats against the first. Those alike are computed at once."""
    halves: dict[tuple[int, int, int], list[tuple[int, int, Sequence[StoredRun]]]] = defaultdict(list)
    for session in sessions:
        for configuration, repeats in _by_configuration(runs.get(session.key, ())).items():
            timed = [run for run in repeats if run.mean_us]
            half = len(timed) // 2
            if half:
                compared = (*timed[:half], *timed[-half:])
                size = min(len(run.frame_us) for run in compared)
                alike = (session.front.protocol.first_counted_frame, half, size)
                halves[alike].append((session.key, configuration, compared))
    found: dict[int, dict[int, float | None]] = defaultdict(dict)
    for (first_counted, half, size), group in halves.items():
        packed = [run.frame_us[:size] for _, _, compared in group for run in compared]
        times = packing.unpack_many(packed).reshape(len(group), 2 * half, -1)
        values = measures.drifts(times[:, :half], times[:, half:], first_counted)
        for (key, configuration, _), value in zip(group, values, strict=True):
            found[key][configuration] = value
    return found


def _summaries(
    session: SessionInput,
    runs: Sequence[StoredRun],
    drifts: Mapping[int, float | None],
    clock_mhz: Sequence[float],
) -> list[SessionSummary]:
    by_configuration = _by_configuration(runs)
    baseline = session.front.baseline
    if baseline is None or baseline not in by_configuration:
        return []
    against = by_configuration.pop(baseline)
    in_order = len({run.order for run in runs}) == len(runs)

    def largest(key: int) -> float | None:
        """The drift that is farthest from 1, in either direction."""
        found = (drifts.get(key), drifts.get(baseline))
        return max((drift for drift in found if drift), key=lambda drift: abs(math.log(drift)), default=None)

    return [
        SessionSummary(
            cohort_id=session.cohort,
            installation_id=session.installation,
            session_id=session.key,
            configuration_id=key,
            baseline_id=baseline,
            algorithm=version.ALGORITHM,
            started_at=session.started_at,
            day=session.day,
            counted=True,  # until its day's sessions are counted
            ate_max=max((run.ate_max for run in candidate if run.ate_max is not None), default=None),
            **_comparison(session, key, candidate, against, largest(key), clock_mhz, in_order),
        )
        for key, candidate in by_configuration.items()
    ]


def _comparison(
    session: SessionInput,
    configuration: int,
    candidate: list[StoredRun],
    against: list[StoredRun],
    drift: float | None,
    clock_mhz: Sequence[float],
    in_order: bool,
) -> dict[str, Any]:
    """What a summary says of CONFIGURATION, from its runs CANDIDATE and those of the baseline AGAINST.

    IN_ORDER: no two runs of the session claim the same place.
    """
    protocol, runs = session.front.protocol, [*candidate, *against]
    planned = session.front.planned_repeats(configuration)
    counted, baseline = _counted(candidate), _counted(against)
    ratios = measures.paired_log_ratios(_times(baseline), _times(counted))
    log_ratio = float(ratios.mean()) if len(ratios) else None
    if log_ratio is None:
        rule: Rule | None = _without_pair(runs)
    elif session.released:
        rule = rules.RELEASED
    else:
        broken = {
            rules.EMULATOR: session.emulated,
            rules.INCOMPLETE_PAIRS: not measures.complete_pairs(_places(baseline), _places(counted), planned),
            rules.UNBALANCED_ORDER: not in_order
            or not measures.balanced_order(_places(baseline), _places(counted)),
            _drift_rule(drift, clock_mhz): measures.has_drifted(drift),
        }
        reasons = {run.reason for run in runs} & PASSED_ON
        reasons |= {rule.code for rule, is_broken in broken.items() if is_broken}
        rule = next((rule for rule in RULES.values() if rule.code in reasons), None)
    interval = measures.session_interval(ratios, planned, protocol.fixed_pairs)
    low, high = interval or (None, None)
    return {
        "log_ratio": log_ratio,
        "low": low,
        "high": high,
        "pairs": len(ratios),
        "runs": len(candidate),
        "failed": sum(run.reason == rules.FAILED.code for run in candidate),
        "lost": sum(run.reason == rules.ATE_ABOVE_LIMIT.code for run in candidate),
        "drift": drift,
        "state": State.VALID if rule is None else rule.state,
        "reason": "" if rule is None else rule.code,
    }


def _by_configuration(runs: Iterable[StoredRun]) -> dict[int, list[StoredRun]]:
    found: dict[int, list[StoredRun]] = defaultdict(list)
    for run in runs:
        found[run.configuration_id].append(run)
    return found


def _counted(runs: Iterable[StoredRun]) -> list[StoredRun]:
    return [run for run in runs if run.mean_us and run.state not in HIDDEN]


def _times(runs: Iterable[StoredRun]) -> dict[int, float]:
    """Mean microseconds by repeat."""
    return {run.repeat: run.mean_us for run in runs if run.mean_us}


def _places(runs: Iterable[StoredRun]) -> dict[int, int]:
    """The place among all runs of the session, by repeat."""
    return {run.repeat: run.order for run in runs}


def _without_pair(runs: list[StoredRun]) -> Rule:
    """Why RUNS give no ratio: what hides one of them, or else the rule that the first of them broke."""
    broken = [RULES[run.reason] for run in runs if run.state in HIDDEN]
    hidden = [rule for rule in broken if rule.state == State.QUARANTINED]
    return next(iter(hidden + broken), rules.NO_PAIR)


def _drift_rule(drift: float | None, clock_mhz: Sequence[float]) -> Rule:
    """THROTTLING for a device that slowed down while its processor's clock fell, DRIFT for any other."""
    fall = measures.clock_fall(clock_mhz)
    slower = drift is not None and drift > 1
    return rules.THROTTLING if slower and fall is not None and fall > MAX_DRIFT else rules.DRIFT
