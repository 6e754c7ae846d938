"""Second step: summarise sessions from judged runs. Compares each configuration with the baseline."""

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import date, datetime
from typing import Any
from uuid import UUID

from crowd.results.models import SessionSummary, State
from crowd.results.validity import measures, rules, version
from crowd.results.validity.rules import RULES, Rule, Scope
from crowd.results.validity.runs import Front, StoredRun
from wire import session_statistics
from wire.session_statistics import RunTime

EXCLUDED_STATES = frozenset({State.INVALID, State.QUARANTINED})
# Reasons of a run that apply to its session, too.
INHERITED_REASONS = frozenset(
    rule.code for rule in RULES.values() if rule.level == Scope.RUN and rule.state == State.SUSPECT
) | {rules.IDENTICAL_SERIES.code}


@dataclass(frozen=True)
class SessionInput:
    """What the summaries of a session need besides its runs.

    `day`: the server's day (UTC) that the session counts for. `on_processor`: no graphics chip computed.
    `emulated`: its device is an emulator. `released`: an administrator released it.
    """

    key: int
    cohort: int
    installation: UUID
    started_at: datetime
    day: date
    front: Front
    on_processor: bool
    emulated: bool
    released: bool


def summarise(
    sessions: Sequence[SessionInput], runs: Mapping[int, Sequence[StoredRun]]
) -> list[SessionSummary]:
    """A summary of each configuration of each session, except the baseline. A session without it has none.

    `runs`: judged runs by the key of their session, ordered by repeat. A released session counts if it has a
    pair of runs. Nothing is stored.
    """
    return [summary for session in sessions for summary in _summaries(session, runs.get(session.key, ()))]


def _summaries(session: SessionInput, runs: Sequence[StoredRun]) -> list[SessionSummary]:
    by_configuration = _by_configuration(runs)
    baseline = session.front.baseline
    if baseline is None or baseline not in by_configuration:
        return []
    baseline_runs = by_configuration.pop(baseline)
    in_order = len({run.order for run in runs}) == len(runs)
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
            **_comparison(session, key, candidate, baseline_runs, in_order),
        )
        for key, candidate in by_configuration.items()
    ]


def _comparison(
    session: SessionInput,
    configuration: int,
    candidate: list[StoredRun],
    baseline_runs: list[StoredRun],
    in_order: bool,
) -> dict[str, Any]:
    """The columns of the summary of `configuration`, from its runs `candidate` and the `baseline_runs`.

    `in_order`: no two runs of the session have the same position.
    """
    runs = [*candidate, *baseline_runs]
    planned = session.front.planned_repeats(configuration)
    counted, baseline = _counted(candidate), _counted(baseline_runs)
    speedup = session_statistics.compare(
        _times(session, baseline), _times(session, counted), session.on_processor
    )
    if speedup is None:
        rule: Rule | None = _missing_pair_rule(runs)
    elif session.released:
        rule = rules.RELEASED
    else:
        violated = {
            rules.EMULATOR: session.emulated,
            rules.INCOMPLETE_PAIRS: not measures.complete_pairs(
                _positions(baseline), _positions(counted), planned
            ),
            rules.UNBALANCED_ORDER: not in_order
            or not measures.balanced_order(_positions(baseline), _positions(counted)),
            rules.CONTENDED: speedup.contended,
            rules.SPEEDUP_CHANGED: speedup.changed,
        }
        reasons = {run.reason for run in runs} & INHERITED_REASONS
        reasons |= {rule.code for rule, is_violated in violated.items() if is_violated}
        rule = next((rule for rule in RULES.values() if rule.code in reasons), None)
    low, high = (speedup and speedup.interval) or (None, None)
    return {
        "log_ratio": speedup and speedup.log,
        "low": low,
        "high": high,
        "clock": speedup.clock if speedup else session_statistics.WALL,
        "pairs": speedup.pairs if speedup else 0,
        "runs": len(candidate),
        "failed": sum(run.reason == rules.FAILED.code for run in candidate),
        "lost": sum(run.reason == rules.ATE_ABOVE_LIMIT.code for run in candidate),
        "drift": _largest_drift(candidate, baseline_runs),
        "state": State.VALID if rule is None else rule.state,
        "reason": "" if rule is None else rule.code,
    }


def _by_configuration(runs: Iterable[StoredRun]) -> dict[int, list[StoredRun]]:
    by_configuration: dict[int, list[StoredRun]] = defaultdict(list)
    for run in runs:
        by_configuration[run.configuration_id].append(run)
    return by_configuration


def _counted(runs: Iterable[StoredRun]) -> list[StoredRun]:
    return [run for run in runs if run.mean_us and run.state not in EXCLUDED_STATES]


def _times(session: SessionInput, runs: Iterable[StoredRun]) -> dict[int, RunTime]:
    """The times of `runs`, all of one configuration, by repeat."""
    protocol = session.front.protocol
    frames = protocol.frames - protocol.first_counted_frame
    return {
        run.repeat: RunTime.of(run.mean_us, frames, run.cpu_us, run.waited_us) for run in runs if run.mean_us
    }


def _positions(runs: Iterable[StoredRun]) -> dict[int, int]:
    """The position among all runs of the session, by repeat."""
    return {run.repeat: run.order for run in runs}


def _missing_pair_rule(runs: list[StoredRun]) -> Rule:
    """Why `runs` have no pair: the rule that quarantines one of them, else the rule that excludes the
    first."""
    violated = [RULES[run.reason] for run in runs if run.state in EXCLUDED_STATES]
    hidden = [rule for rule in violated if rule.state == State.QUARANTINED]
    return next(iter(hidden + violated), rules.NO_PAIR)


def _largest_drift(*configurations: Sequence[StoredRun]) -> float | None:
    """The drift that is farthest from 1 among `configurations`, each the runs of one."""
    times = [[run.mean_us for run in runs if run.mean_us] for runs in configurations]
    drifts = map(session_statistics.drift, times)
    return max((drift for drift in drifts if drift), key=lambda drift: abs(math.log(drift)), default=None)
