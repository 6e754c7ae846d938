"""One session's answer: each configuration's runs against those of the baseline."""

from collections import defaultdict
from collections.abc import Iterable
from datetime import UTC
from typing import Any

from crowd.devices.models import DeviceModel
from crowd.results import packing, rules, statistics
from crowd.results.checks import Protocol
from crowd.results.models import Cohort, MeasurementSession, Run, SessionSummary, State
from crowd.results.rules import Rule

HIDDEN = frozenset({State.INVALID, State.QUARANTINED})


def summaries(
    session: MeasurementSession, cohort: Cohort, runs: Iterable[Run], baseline: int | None, released: bool
) -> list[SessionSummary]:
    """One summary for every configuration but the BASELINE (a key); none where the baseline did not run.

    RUNS are judged and in order of their repeats. A RELEASED session counts where it has a pair of runs at
    all. Nothing is stored.
    """
    by_configuration: dict[int, list[Run]] = defaultdict(list)
    for run in runs:
        by_configuration[run.configuration_id].append(run)
    if baseline is None or baseline not in by_configuration:
        return []
    against = by_configuration.pop(baseline)
    started_at = session.started_at.astimezone(UTC)
    return [
        SessionSummary(
            cohort=cohort,
            installation_id=session.installation_id,
            session=session,
            configuration_id=key,
            baseline_id=baseline,
            algorithm=statistics.ALGORITHM,
            started_at=started_at,
            day=started_at.date(),
            counted=True,  # until its day's sessions are counted
            ate_max=max((run.ate_max for run in candidate if run.ate_max is not None), default=None),
            **_answer(session, candidate, against, released),
        )
        for key, candidate in by_configuration.items()
    ]


def _answer(
    session: MeasurementSession, candidate: list[Run], against: list[Run], released: bool
) -> dict[str, Any]:
    ratios = statistics.paired_log_ratios(_values(against), _values(candidate))
    first = Protocol.of(session.front.protocol).first_counted_frame
    drifts = [drift for runs in (against, candidate) if (drift := _drift(runs, first)) is not None]
    drift = max(drifts, default=None)
    runs = [*candidate, *against]
    if not len(ratios):
        rule: Rule | None = _without_pair(runs)
    elif released:
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


def _values(runs: list[Run]) -> dict[int, float]:
    """Mean microseconds by repeat, of the runs that count."""
    return {run.repeat: run.mean_us for run in runs if run.mean_us and run.state not in HIDDEN}


def _drift(runs: list[Run], first_counted_frame: int) -> float | None:
    """The last repeat of a configuration against its first."""
    timed = [run for run in runs if run.mean_us]
    if len(timed) < 2:
        return None
    first, last = packing.unpack(timed[0].frame_us), packing.unpack(timed[-1].frame_us)
    return statistics.drift(first, last, first_counted_frame)


def _without_pair(runs: list[Run]) -> Rule:
    """Why RUNS give no ratio: what hides one of them, or else the rule that the first of them broke."""
    broken = [rules.RULES[run.reason] for run in runs if run.state in HIDDEN]
    hidden = [rule for rule in broken if rule.state == State.QUARANTINED]
    return next(iter(hidden + broken), rules.NO_PAIR)


def _broken(session: MeasurementSession, reasons: set[str], drift: float | None) -> Rule | None:
    """The first rule that a session with a ratio breaks; REASONS are those of its runs."""
    if rules.IDENTICAL_SERIES.code in reasons:
        return rules.IDENTICAL_SERIES
    if session.description.model.kind == DeviceModel.Kind.EMULATOR:
        return rules.EMULATOR
    if drift is not None and drift > statistics.MAX_DRIFT:
        return rules.THROTTLING if _clock_fell(session.samples) else rules.DRIFT
    suspicions = (rule for rule in rules.RULES.values() if rule.state == State.SUSPECT)
    return next((rule for rule in suspicions if rule.code in reasons), None)


def _clock_fell(samples: list[dict[str, Any]]) -> bool:
    fall = statistics.clock_fall([sample["cpu_mhz"] for sample in samples if sample.get("cpu_mhz")])
    return fall is not None and fall > statistics.MAX_DRIFT
