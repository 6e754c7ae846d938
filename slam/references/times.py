"""Times of a front's points on the clients' sequence, relative to its default, and which of two is faster.

An exploration times points over several sequences, and its order of close ones is luck. Here all points run
in turn, in rounds, each beside a default that ran lately. Points that are not told apart run in further
rounds.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import exp, log, sqrt
from statistics import fmean, median, stdev
from typing import Any, Literal, NamedTuple

from scipy.special import stdtrit

from slam.system import STAGES
from wire.session_statistics import RunTime, contended

DEFAULT = "default"
ROUNDS, MOST_ROUNDS = 4, 12
EVERY = 8  # the default runs again before so many points
EQUAL = log(1.03)  # a ratio within 3 % makes two points equal
PUBLISHED_LEVEL = 0.95
DECIDED_LEVEL = 0.99  # pairs are looked at up to nine times, so each look is stricter
DECIMALS = 6

Order = Literal["faster", "slower", "equal", "open"]


class Timed(NamedTuple):
    """A run of the point `name` in a round: seconds a frame, and of each stage.

    `cpu` and `waited`: seconds a frame of the processor, and that threads waited for one; None if unknown.
    """

    round: int
    name: str
    runtime: float
    stages: Mapping[str, float]
    cpu: float | None = None
    waited: float | None = None

    @property
    def time(self) -> RunTime:
        used = (None if seconds is None else 1e6 * seconds for seconds in (self.cpu, self.waited))
        return RunTime(1e6 * self.runtime, *used)


@dataclass(frozen=True)
class Relative:
    """A point's times over those of the default that ran last before: by round, and of each stage.

    `processor`: the same of processor times, where both are known.
    """

    ratios: Mapping[int, float]
    stages: Sequence[Mapping[str, float]]
    processor: Sequence[float] = ()

    def summary(self) -> dict[str, Any]:
        """`runtime_ratio` with its 95 % interval `low` to `high`, `rounds`, medians of `stages`, and
        `processor_ratio`, the mean by processor time, where it is known."""
        mean, half = _interval([log(ratio) for ratio in self.ratios.values()], PUBLISHED_LEVEL)
        known = [log(ratio) for ratio in self.processor]
        by_processor = {"processor_ratio": round(exp(fmean(known)), DECIMALS)} if known else {}
        return by_processor | {
            "runtime_ratio": round(exp(mean), DECIMALS),
            "low": round(exp(mean - half), DECIMALS),
            "high": round(exp(mean + half), DECIMALS),
            "rounds": len(self.ratios),
            "stages": {
                stage: round(median(stages[stage] for stages in self.stages), DECIMALS)
                for stage in STAGES
                if all(stage in stages for stages in self.stages)
            },
        }


def with_default(names: Iterable[str]) -> list[str]:
    """`names` with the default before every EVERY of the others, as a round runs them."""
    others = [name for name in names if name != DEFAULT]
    parts = [others[begin : begin + EVERY] for begin in range(0, max(len(others), 1), EVERY)]
    return [name for part in parts for name in (DEFAULT, *part)]


def undisturbed(runs: Sequence[Timed]) -> list[Timed]:
    """Those of `runs`, in their order, that other programs disturbed neither themselves nor in the default
    before them."""
    times_of: dict[str, list[RunTime]] = {}
    for run in runs:
        times_of.setdefault(run.name, []).append(run.time)
    marks = {name: iter(contended(times)) for name, times in times_of.items()}
    clean, beside_disturbed = [], False
    for run in runs:
        is_disturbed = next(marks[run.name])
        if run.name == DEFAULT:
            beside_disturbed = is_disturbed
        if not is_disturbed and not beside_disturbed:
            clean.append(run)
    return clean


def open_round(runs: Sequence[Timed]) -> tuple[int, dict[str, int]] | None:
    """The first round with points that have no undisturbed run there, with how often each of these ran."""
    ran = Counter((run.round, run.name) for run in runs)
    left = ran.keys() - {(run.round, run.name) for run in undisturbed(runs)}
    if not left:
        return None
    first = min(number for number, _ in left)
    return first, {
        name: times for (number, name), times in ran.items() if (number, name) in left and number == first
    }


def relative(runs: Iterable[Timed]) -> dict[str, Relative]:
    """The times of each point, from `runs` in the order in which they ran.

    Runs before the first one of the default are left out.
    """
    ratios: dict[str, dict[int, float]] = {}
    stages: dict[str, list[dict[str, float]]] = {}
    processor: dict[str, list[float]] = {}
    default: Timed | None = None
    for run in runs:
        default = run if run.name == DEFAULT else default
        if default is not None and default.runtime > 0:
            ratios.setdefault(run.name, {})[run.round] = run.runtime / default.runtime
            shares = {stage: seconds / default.runtime for stage, seconds in run.stages.items()}
            stages.setdefault(run.name, []).append(shares)
            if run.cpu and default.cpu:
                processor.setdefault(run.name, []).append(run.cpu / default.cpu)
    return {name: Relative(values, stages[name], processor.get(name, ())) for name, values in ratios.items()}


def order(one: Relative, other: Relative) -> Order:
    """Whether `one` is faster or slower than `other`, or equal, from the rounds in which both ran.

    Equal: the interval of their ratio lies within 3 %. Open: it tells neither.
    """
    logs = [log(one.ratios[number] / other.ratios[number]) for number in one.ratios.keys() & other.ratios]
    if len(logs) < 2:
        return "open"
    mean, half = _interval(logs, DECIDED_LEVEL)
    if abs(mean) + half <= EQUAL:
        return "equal"
    if abs(mean) <= half:
        return "open"
    return "faster" if mean < 0 else "slower"


def undecided(found: Mapping[str, Relative], names: Iterable[str]) -> dict[str, list[str]]:
    """The points of `names` that were not told apart from others, with these; in the order of `names`."""
    chosen = [name for name in names if name in found]
    pairs = [(a, b) for a, b in combinations(chosen, 2) if order(found[a], found[b]) == "open"]
    beside = {name: [b if a == name else a for a, b in pairs if name in (a, b)] for name in chosen}
    return {name: others for name, others in beside.items() if others}


def next_round(
    found: Mapping[str, Relative], points: Sequence[str], probes: Sequence[str], done: int
) -> list[str]:
    """The names to run in the round after `done` others, with defaults; nothing once all is known.

    The first ROUNDS run everything. Up to MOST_ROUNDS, the undecided `points` follow.
    """
    if done < ROUNDS:
        return with_default([*points, *probes])
    chosen = undecided(found, points) if done < MOST_ROUNDS else {}
    return with_default(chosen) if chosen else []


def beaten(found: Mapping[str, Relative], errors: Mapping[str, float], kept: Iterable[str]) -> dict[str, str]:
    """The points that another beats or equals in error (m) and time, each with that one's name.

    `errors`: by the names of all points. Those in `kept` are never beaten.
    """
    kept = set(kept)
    ranked = sorted(errors, key=lambda name: (errors[name], name not in kept, _mean_ratio(found[name])))
    left: list[str] = []
    lost: dict[str, str] = {}
    for name in ranked:
        better = (other for other in left if order(found[other], found[name]) in ("faster", "equal"))
        winner = None if name in kept else next(better, None)
        if winner is None:
            left.append(name)
        else:
            lost[name] = winner
    return lost


def _mean_ratio(point: Relative) -> float:
    return fmean(log(ratio) for ratio in point.ratios.values())


def _interval(logs: Sequence[float], level: float) -> tuple[float, float]:
    """The mean of `logs` and half the width of its interval by Student's t; 0 wide for a single value."""
    if len(logs) < 2:
        return logs[0], 0.0
    spread = stdev(logs) / sqrt(len(logs))
    return fmean(logs), float(stdtrit(len(logs) - 1, (1 + level) / 2)) * spread
