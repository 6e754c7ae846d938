"""The finding of a chart in one sentence, which is its title on a page. Pure functions of its rows.

Sentences are right for all cases: no device, one, two, all slower, ties.
"""

from collections.abc import Sequence
from statistics import median

from crowd.dashboard import formats
from crowd.dashboard.content.drift import Readings, Step
from crowd.dashboard.content.stages import StageSpread, StageTimes
from crowd.records.session import SessionSpeedup
from crowd.results.models import State
from crowd.results.reading.backends import BACKENDS
from crowd.results.reading.rows import History, ModelOutcomes, Ranking
from crowd.results.reading.transferring.rows import Winners
from wire.front import DEFAULT
from wire.protocol import MAX_DRIFT

# A sensor whose readings stay within this share of the largest one is steady.
STEADY = 0.02


def crowd(
    speedups: Sequence[float],
    mean: float | None,
    configuration: str,
    uncounted: int = 0,
    outcomes: ModelOutcomes | None = None,
    wide: tuple[float, float] | None = None,
) -> str:
    """On how many device models `configuration` is faster, and their `mean`.

    `speedups` has a number per counted model; `uncounted` others were measured. `outcomes`: on how many it
    failed, which have no speedup. `wide`: the interval that is shown in place of a single speedup.
    """
    if not speedups:
        return _none_counts(uncounted)
    if len(speedups) == 1:
        kind = "confirmed device" if uncounted else "device"
        return f"One {kind} so far: {configuration} is {_gain(speedups[0], wide)}"
    faster = sum(speedup > 1 for speedup in speedups)
    if len(speedups) == 2:
        values = f"{formats.speedup(max(speedups))} and {formats.speedup(min(speedups))}"
    else:
        values = f"{formats.speedup(mean)} in the mean"
    finding = f"{_of_all(faster, len(speedups))} faster with {configuration}: {values}"
    if outcomes is None or not outcomes.failing:
        return finding
    failed = formats.share(outcomes.failing, outcomes.devices)
    return f"{finding}; {configuration} did not finish on {failed} tried from enough networks"


def _gain(speedup: float, wide: tuple[float, float] | None = None) -> str:
    words = "faster than" if speedup > 1 and not wide else "as fast as"
    return f"{formats.speedup(speedup, wide)} {words} the default"


def _none_counts(uncounted: int) -> str:
    if not uncounted:
        return "No device has been measured yet"
    if uncounted == 1:
        return "One device was measured, and its figure is not confirmed yet"
    return f"None of {formats.plural(uncounted, 'device')} has a confirmed figure yet"


def _of_all(some: int, count: int) -> str:
    """Subject and verb for `some` of `count` (two or more)."""
    if some == count:
        return "Both devices are" if count == 2 else f"Every one of {formats.plural(count, 'device')} is"
    if not some:
        return "Neither of two devices is" if count == 2 else f"None of {formats.plural(count, 'device')} is"
    return f"{some:,} of {formats.plural(count, 'device')} {'is' if some == 1 else 'are'}"


def regret(found: Winners) -> str:
    """How the configuration that is the fastest on the reference device performs on others."""
    name, wins, judged = found.reference, found.wins, found.judged
    if not judged or found.median_regret is None:
        return f"No device has a valid figure of {name} to compare yet"
    times = formats.speedup(found.median_regret)
    if judged == 1:
        if wins:
            return f"On the one device {name} is the fastest configuration"
        return f"On the one device {name} takes {times} the time of the fastest"
    devices = formats.plural(judged, "device")
    if wins == judged:
        return f"On all of {devices} {name} is the fastest configuration"
    where = f"On {formats.count(wins)} of {devices}" if wins else f"On none of {devices}"
    return f"{where} {name} is the fastest: in the median it takes {times} the time"


def winners(counts: Sequence[tuple[str, int]], devices: int) -> str:
    """Which configuration is the fastest on the most of `devices`; `counts` has most first."""
    if not counts:
        return "No device has measured several configurations yet"
    most = counts[0][1]
    leaders = [name for name, count in counts if count == most]
    if devices == 1:
        return f"On the one device {leaders[0]} is the fastest"
    of = f"{formats.count(most)} of {formats.plural(devices, 'device')}"
    if len(leaders) == 1:
        return f"On {of} {leaders[0]} is the fastest"
    if len(leaders) == 2:
        return f"Two configurations, {leaders[0]} and {leaders[1]}, are each the fastest on {of}"
    return f"{formats.count(len(leaders))} configurations are each the fastest on {of}"


def alike(coefficients: Sequence[float], kind: str) -> str:
    """How similar devices are: `coefficients` of the `kind`, one per pair."""
    if not len(coefficients):
        return "No two devices can be compared yet"
    where = "on the one pair of devices"
    if len(coefficients) > 1:
        where = f"in the median of {formats.plural(len(coefficients), 'pair')} of devices"
    return f"Times correlate with {formats.coefficient(float(median(coefficients)))} ({kind.title()}) {where}"


def place(found: Ranking, confirmed: bool) -> str:
    """The rank of a device among counted ones."""
    if found.slower is None:
        return "The first device with a confirmed figure" if confirmed else "No other device is confirmed yet"
    of = f"{formats.count(found.rank)} of {formats.plural(len(found.models), 'device model')}"
    if not confirmed:
        return f"No rank yet: once confirmed it would have rank {of}"
    ties = sum(speedup == found.speedup for _, speedup in found.models) > 1
    if found.rank == 1:
        return f"Rank {of}: {'no other gains more' if ties else 'it gains the most'}"
    if not found.slower:
        return f"Rank {of}: no other gains less"
    return f"Rank {of}: it gains more than {formats.percent(found.slower)} of the others"


def configurations(
    winner: str, speedup: float, count: int, best_rank: int | None, wide: tuple[float, float] | None = None
) -> str:
    """Which of `count` configurations is the fastest on one device, and the rank of `best`.

    `wide`: the interval that is shown in place of its speedup.
    """
    if count == 1:
        return "No configuration besides the default has a figure that counts here"
    of = formats.plural(count, "configuration")
    if winner == DEFAULT:
        return f"Of {of} none is faster than the default here"
    rank = f"; best has rank {best_rank}" if best_rank is not None and best_rank > 1 else ""
    return f"Of {of} {winner} is the fastest here: {formats.speedup(speedup, wide)}{rank}"


def releases(history: History | None) -> str:
    """The range of speedups over drivers and systems, with one backend."""
    if history is None or not history.releases:
        return "No driver is known"
    rows, way = history.releases, BACKENDS.get(history.backend, history.backend)
    if len(rows) == 1:
        return f"{formats.speedup(rows[0].speedup)} with {way} under the one driver and system seen so far"
    low, high = min(row.speedup for row in rows), max(row.speedup for row in rows)
    where = f"{formats.plural(len(rows), 'release')} of driver and system"
    if formats.speedup(low) == formats.speedup(high):
        return f"{formats.speedup(low)} with {way} under each of {where}"
    return f"{formats.interval(low, high)} with {way} under {where}"


def session(answers: Sequence[SessionSpeedup]) -> str:
    """The fastest configuration of a session, without suspect results."""
    speedups = {
        row.configuration: row.speedup
        for row in answers
        if row.speedup is not None and row.state == State.VALID
    }
    if not speedups:
        measured = any(row.speedup is not None for row in answers)
        if measured:
            return "No speedup of this session counts"
        return "No run can be compared with one of the default"
    name = min(speedups, key=lambda each: (-speedups[each], each))
    wide = next(row.range for row in answers if row.configuration == name)
    if len(speedups) == 1:
        return f"In this session {name} is {_gain(speedups[name], wide)}"
    if speedups[name] <= 1:
        return f"None of {formats.plural(len(speedups), 'configuration')} is faster than the default"
    of = formats.plural(len(speedups) + 1, "configuration")
    return f"Of {of} {name} is the fastest: {formats.speedup(speedups[name], wide)}"


def stages(rows: Sequence[StageTimes]) -> str:
    """The longest stage of the first configuration, and its share in the fastest one."""
    shares = {row.configuration: _shares(row) for row in rows}
    first = DEFAULT if shares.get(DEFAULT) else next((name for name, each in shares.items() if each), None)
    if first is None:
        return "No times of single stages"
    stage = max(shares[first], key=lambda name: shares[first][name])
    words = f"{stage.capitalize()} takes {formats.percent(shares[first][stage])} of the time of {first}"
    fastest = min(rows, key=lambda row: row.computation).configuration
    if fastest == first or not shares[fastest]:
        return words
    return f"{words} and {formats.percent(shares[fastest].get(stage, 0.0))} of {fastest}"


def _shares(row: StageTimes) -> dict[str, float]:
    return {stage: seconds / row.computation for stage, seconds in row.seconds.items() if row.computation}


def run(spread: Sequence[StageSpread]) -> str:
    """The longest stage of a run."""
    if not spread:
        return "No times of single stages"
    most = max(spread, key=lambda row: row.share)
    return f"{most.stage.capitalize()} takes {formats.percent(most.share)} of the time"


def drift(steps: Sequence[Step]) -> str:
    """How much the runs of a session slowed down."""
    if len({step.configuration for step in steps}) == len(steps):
        return "No configuration ran twice"
    worst = max(steps, key=lambda step: step.ratio)
    if worst.ratio <= 1:
        return "No run took longer than the first of its configuration"
    longer = f"{formats.percent(worst.ratio - 1)} longer"
    if worst.ratio > MAX_DRIFT:
        return f"Run {worst.place}, of {worst.configuration}, took {longer} than its first"
    return f"No run took more than {longer} than the first of its configuration"


def sensors(rows: Sequence[Readings]) -> str:
    """The changes of temperature, clock and battery over a session."""
    words = "; ".join(map(_sensor, rows)) or "no sensor was reported"
    return words[0].upper() + words[1:]


def _sensor(readings: Readings) -> str:
    first, last = readings.values[0], readings.values[-1]
    low, high = min(readings.values), max(readings.values)
    gap = formats.GAP
    if high - low <= STEADY * abs(high):
        return f"{readings.name} steady at {formats.significant(last)}{gap}{readings.unit}"
    verb = "rose" if last > first else "fell" if last < first else "varied"
    ends = (low, high) if verb == "varied" else (first, last)
    from_to = f"from {formats.significant(ends[0])} to {formats.significant(ends[1])}{gap}{readings.unit}"
    return f"{readings.name} {verb} {from_to}"
