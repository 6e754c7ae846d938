"""Differences in speed: a ratio, its 95 % confidence interval, and a sentence about it.

crowd.results.figures.statistics computes ratios and intervals.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from crowd.dashboard import formats
from crowd.records.speedup import Speedup
from crowd.records.uncertainty import LEAST_UNITS, Estimate
from crowd.results.figures.statistics import Interval, estimate, mean_of, ratio_between
from crowd.results.reading.rows import SessionDetail
from wire.front import BEST, DEFAULT
from wire.session_statistics import paired_log_ratios

FASTER = "is faster than"
GAINS = "gains more than"


@dataclass(frozen=True)
class Difference:
    """The difference of `one` and `other`. `ratio` is above 1 if `one` is ahead.

    `verb` names the quantity, `where` the condition. `basis` says what the interval is based on, or why there
    is none.
    """

    one: str
    other: str
    verb: str
    where: str
    ratio: Interval
    basis: str

    @property
    def known(self) -> bool:
        """Whether there is an interval."""
        return self.ratio.low is not None

    @property
    def decided(self) -> bool:
        """Whether the interval excludes equality."""
        low, high = self.ratio.low, self.ratio.high
        return low is not None and high is not None and (low > 1 or high < 1)

    @property
    def sentence(self) -> str:
        """The finding in words."""
        if self.known and not self.decided:
            return (
                f"There is no clear difference between {self.one} and {self.other}{self.where}: "
                f"the ratio of the first to the second is {_with_interval(self.ratio)}."
            )
        ahead = self._reversed() if self.ratio.value < 1 else self
        if not self.known and formats.speedup(ahead.ratio.value) == formats.speedup(1.0):
            text = f"There is no difference between {self.one} and {self.other}{self.where}"
        else:
            text = f"{ahead.one} {self.verb} {ahead.other} by {_with_interval(ahead.ratio)}{self.where}"
        if self.decided:
            return f"{text}. The difference is larger than chance."
        return f"{text} so far. Whether that is more than chance is not known: {self.basis}."

    def _reversed(self) -> "Difference":
        low, high = self.ratio.low, self.ratio.high
        swapped = Interval(1 / self.ratio.value, high and 1 / high, low and 1 / low)
        return Difference(self.other, self.one, self.verb, self.where, swapped, self.basis)


def _with_interval(ratio: Interval) -> str:
    """`ratio` with its interval: 1.30x (1.10-1.50x)."""
    value = formats.speedup(ratio.value)
    if ratio.low is None or ratio.high is None:
        return value
    return f"{value} ({formats.interval(ratio.low, ratio.high)})"


def between_figures(
    names: Sequence[str], figures: Sequence[Speedup], times: Sequence[dict[str, Estimate]]
) -> list[Difference]:
    """The differences of the first of `figures` from the others, all of one front.

    `names`: what each is a figure of. `times` are those of best and default. Two are also compared by their
    gains.
    """
    differences = []
    for name in (BEST, DEFAULT):
        if all(name in each for each in times):
            first, *others = [each[name] for each in times]
            for number, seconds in enumerate(others, 1):
                ratio = ratio_between(seconds, first)
                pair = (names[0], names[number]), (figures[0], figures[number])
                differences.append(_between(*pair, ratio, FASTER, f" with {name}"))
    if len(figures) == 2:
        one, other = figures
        ratio = ratio_between(one.estimate, other.estimate)
        pair = (names[0], names[1]), (one, other)
        differences.append(_between(*pair, ratio, GAINS, " from best over default"))
    return differences


def _between(
    names: tuple[str, str], figures: tuple[Speedup, Speedup], ratio: Interval, verb: str, where: str
) -> Difference:
    """The difference by `ratio`, which is above 1 if the first is ahead, with what it rests on."""
    one, other = figures
    measured = f"{one.units} and {formats.plural(other.units, 'independent installation')}"
    basis = (
        f"over {measured}"
        if ratio.low is not None
        else f"it takes {LEAST_UNITS} independent installations of each; there are {measured}"
    )
    return Difference(*names, verb, where, ratio, basis)


def between_sessions(one: SessionDetail, other: SessionDetail) -> list[Difference]:
    """The differences of two sessions: times of best and default over valid runs, speedups over pairs."""
    names = (_session_name(one), _session_name(other))
    differences = []
    for name in (BEST, DEFAULT):
        first, second = (_times(session, name) for session in (one, other))
        if first and second:
            logs = [[math.log(value) for value in each.values()] for each in (first, second)]
            differences.append(_of_values(names, logs[1], logs[0], FASTER, f" with {name}", "run"))
    ratios = [paired_log_ratios(_times(session, DEFAULT), _times(session, BEST)) for session in (one, other)]
    if all(ratios):
        differences.append(_of_values(names, ratios[0], ratios[1], GAINS, " from best over default", "pair"))
    return differences


def _session_name(detail: SessionDetail) -> str:
    return f"{detail.session.device.title} ({formats.hour(detail.session.started_at)})"


def _times(detail: SessionDetail, configuration: str) -> dict[int, float]:
    """Seconds per frame of the valid runs of `configuration`, by repeat."""
    return {
        series.run.repeat: series.run.mean_seconds
        for series in detail.runs
        if series.run.configuration == configuration
        and series.run.state == "valid"
        and series.run.mean_seconds
    }


def _of_values(
    names: tuple[str, str], above: list[float], below: list[float], verb: str, where: str, noun: str
) -> Difference:
    ratio = ratio_between(estimate(above), estimate(below))
    counts = f"{len(above)} and {formats.plural(len(below), noun)}"
    basis = f"over {counts}" if ratio.low is not None else f"it takes two {noun}s each; there are {counts}"
    return Difference(*names, verb, where, ratio, basis)


@dataclass(frozen=True)
class Pair:
    """A device with a figure on both sides."""

    new: Speedup
    old: Speedup

    @property
    def log(self) -> float:
        return math.log(self.new.speedup / self.old.speedup)

    @property
    def ratio(self) -> float:
        return self.new.speedup / self.old.speedup


def pairs(new: Sequence[Speedup], old: Sequence[Speedup]) -> list[Pair]:
    """Devices with a counted figure in `new` and in `old`, of one backend and chip; largest change first."""
    before = {_place(row): row for row in old if row.counts}
    both = [Pair(row, before[_place(row)]) for row in new if row.counts and _place(row) in before]
    return sorted(both, key=lambda pair: (-pair.ratio, pair.new.device.slug))


def _place(row: Speedup) -> tuple[str, str, str, str]:
    return row.device.slug, row.backend, row.processor, row.processor_class


def over_pairs(both: Sequence[Pair], one: str, other: str, verb: str, where: str) -> Difference | None:
    """The mean difference over all pairs, with the uncertainty of its figures. None without a pair."""
    if not both:
        return None
    new, old = ([getattr(pair, side).estimate for pair in both] for side in ("new", "old"))
    ratio = ratio_between(mean_of(new), mean_of(old))
    devices = formats.plural(len({pair.new.device.slug for pair in both}), "device")
    basis = f"over {devices} with a confirmed figure of both"
    if ratio.low is None:
        basis = f"it takes three devices, or {LEAST_UNITS} independent installations; there is {devices}"
    return Difference(one, other, verb, where, ratio, basis)
