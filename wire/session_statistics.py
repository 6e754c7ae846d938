"""The statistics of a session, for the server and its clients: pure functions of the times of runs.

Runs of a configuration are paired with those of the same repeat of the default. In the order default, best,
best, default the drift of a device that warms up steadily enters two pairs with opposite signs, so that it
cancels in their mean. client_kit/web/speedup.js computes the same for browsers.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean, stdev, variance

from wire.protocol import LEAST_PAIRS

# Student's t, two-sided 95 % and 99 %, for 1 to 24 degrees of freedom: a session has at most 25 pairs. The
# client's requirements do not include SciPy.
QUANTILES_95 = (
    12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228, 2.201, 2.179,
    2.160, 2.145, 2.131, 2.120, 2.110, 2.101, 2.093, 2.086, 2.080, 2.074, 2.069, 2.064,
)  # fmt: skip
QUANTILES_99 = (
    63.657, 9.925, 5.841, 4.604, 4.032, 3.707, 3.499, 3.355, 3.250, 3.169, 3.106, 3.055,
    3.012, 2.977, 2.947, 2.921, 2.898, 2.878, 2.861, 2.845, 2.831, 2.819, 2.807, 2.797,
)  # fmt: skip
# Log ratios of pairs on one device differ by this standard deviation: a smaller one of few pairs is chance.
LEAST_DEVIATION = 0.03
LEVEL = 0.01
# How long the threads of a run may stand ready without a processor. On idle cores they wait for each other at
# each launch of a kernel: a large part of the processor time where frames are short. So the limit is so much
# a frame, but between two parts of the processor time (docs/research/contention.md).
WAITED_A_FRAME_US = 3_500
LEAST_WAITED, MOST_WAITED = 0.25, 0.7
# An interval whose upper end is more than so many times its lower end is shown without its point.
WIDEST_INTERVAL = 1.5
# The largest chance at which the later runs of all configurations being the slower ones is still told.
SLOWDOWN_LEVEL = 0.05
# Where a system does not say that: the part of the most cores that a run must keep busy, where the processor
# and not a GPU does the work.
LEAST_CORES, BUSY_CORES = 0.9, 0.5
# Beside other programs, a ratio of processor times differs from that of the clock on idle cores by this
# standard deviation of the logarithm, because caches and cores are shared.
PROCESSOR_DEVIATION = 0.15
NORMAL_95 = 1.96
WALL, PROCESSOR = "wall", "processor"  # clocks


@dataclass(frozen=True)
class Speedup:
    """The speedup over the baseline: exp(`log`); `interval` bounds `log` with 95 % confidence.

    The interval is over the session's `pairs` of runs: the repeatability within this session. None for fewer
    than LEAST_PAIRS, and if other programs took the processor (`contended`): they slow one configuration more
    than another, all the time. `changed`: it changed within the session, see `speedup_changes`.
    `clock`: PROCESSOR where processor times are compared, since other programs ran; the interval then has
    PROCESSOR_DEVIATION in it.
    """

    log: float
    interval: tuple[float, float] | None
    pairs: int
    changed: bool
    contended: bool = False
    clock: str = WALL

    @property
    def value(self) -> float:
        return math.exp(self.log)

    @property
    def low(self) -> float | None:
        return None if self.interval is None else math.exp(self.interval[0])

    @property
    def high(self) -> float | None:
        return None if self.interval is None else math.exp(self.interval[1])


@dataclass(frozen=True)
class RunTime:
    """Mean microseconds of a counted frame: by the clock, of the processor over all threads, and how long
    threads stood ready without a processor. None where the system does not say."""

    wall_us: float
    cpu_us: float | None
    waited_us: float | None

    @classmethod
    def of(cls, mean_us: float, frames: int, cpu_us: float | None, waited_us: float | None) -> "RunTime":
        """`mean_us` is that of a frame, `cpu_us` and `waited_us` are of all `frames`, as a run says them."""
        return cls(mean_us, *(None if used is None else used / frames for used in (cpu_us, waited_us)))

    @property
    def cores(self) -> float | None:
        """How many cores the run kept busy."""
        return None if self.cpu_us is None or not self.wall_us else self.cpu_us / self.wall_us

    @property
    def waited_limit_us(self) -> float:
        """How long its threads wait at most on idle cores."""
        used = self.cpu_us or self.wall_us
        return min(max(WAITED_A_FRAME_US, LEAST_WAITED * used), MOST_WAITED * used)


def contended(runs: Sequence[RunTime]) -> list[bool]:
    """Whether other programs took the processor from each of the `runs` of one configuration in a session.

    Its threads waited for longer than `waited_limit_us`. Where that is unknown, it kept fewer than
    LEAST_CORES of the cores busy that another run did, if these were at least BUSY_CORES. False where nothing
    is known.
    """
    most = max((run.cores for run in runs if run.cores is not None), default=0.0)
    disturbed = []
    for run in runs:
        if run.waited_us is not None:
            disturbed.append(run.waited_us > run.waited_limit_us)
        else:
            disturbed.append(run.cores is not None and most >= BUSY_CORES and run.cores < LEAST_CORES * most)
    return disturbed


def compare(
    baseline: Mapping[int, RunTime], candidate: Mapping[int, RunTime], on_processor: bool
) -> Speedup | None:
    """The speedup of `candidate` over `baseline`, by repeat the runs that count; None without a pair.

    If other programs disturbed a run, processor times are compared where the processor computed
    (`on_processor`) and all runs say theirs.
    """
    runs = [*baseline.values(), *candidate.values()]
    disturbed = any(any(contended(list(each.values()))) for each in (baseline, candidate))
    if disturbed and on_processor and all(run.cpu_us for run in runs):
        used = [{repeat: run.cpu_us or 0.0 for repeat, run in each.items()} for each in (baseline, candidate)]
        return speedup(paired_log_ratios(*used), clock=PROCESSOR)
    means = [{repeat: run.wall_us for repeat, run in each.items()} for each in (baseline, candidate)]
    return speedup(paired_log_ratios(*means), disturbed)


def paired_log_ratios(baseline: Mapping[int, float], candidate: Mapping[int, float]) -> list[float]:
    """log(baseline / candidate) of each repeat that both have, in the order of the repeats.

    `baseline` and `candidate` map repeats to the mean times of runs, in one unit.
    """
    repeats = sorted(baseline.keys() & candidate.keys())
    return [math.log(baseline[repeat] / candidate[repeat]) for repeat in repeats]


def speedup(log_ratios: Sequence[float], contended: bool = False, clock: str = WALL) -> Speedup | None:
    """The geometric mean of the ratios with its t interval, unless `contended`; None without a pair."""
    if not log_ratios:
        return None
    centre, pairs = fmean(log_ratios), len(log_ratios)
    interval = None
    if not contended and pairs >= LEAST_PAIRS:
        half = _quantile(QUANTILES_95, pairs - 1) * stdev(log_ratios) / math.sqrt(pairs)
        if clock == PROCESSOR:
            half = math.hypot(half, NORMAL_95 * PROCESSOR_DEVIATION)
        interval = centre - half, centre + half
    return Speedup(centre, interval, pairs, speedup_changes(log_ratios), contended, clock)


def speedup_changes(log_ratios: Sequence[float]) -> bool:
    """Whether the second half of `log_ratios` differs from the first by more than chance.

    Student's test of two samples at LEVEL, with a deviation of at least LEAST_DEVIATION. The middle one of an
    odd number is left out. Fewer than four pairs cannot show a change.
    """
    half = len(log_ratios) // 2
    if half < 2:
        return False
    first, second = log_ratios[:half], log_ratios[-half:]
    change = abs(fmean(second) - fmean(first))
    deviation = max(math.sqrt((variance(first) + variance(second)) / 2), LEAST_DEVIATION)
    return change > _quantile(QUANTILES_99, 2 * half - 2) * deviation * math.sqrt(2 / half)


def wide_range(low: float | None, high: float | None) -> tuple[float, float] | None:
    """The interval from `low` to `high` if it is too wide to show one number for it; else None."""
    if low is None or high is None or high <= WIDEST_INTERVAL * low:
        return None
    return low, high


def slowed_down(times: Iterable[Sequence[float]]) -> float | None:
    """How many times longer the later runs of a session took; None where that can be chance, or did not last.

    `times`: of each configuration, the times of its runs in the order measured, in one unit. In each, every
    run of the second half took longer than every run of the first, by LEAST_DEVIATION. The middle one of an
    odd number is left out, and so are configurations with one run. Chance, however large, does that in at
    most SLOWDOWN_LEVEL of sessions. The result is the geometric mean over the configurations.
    """
    chance, changes = 1.0, []
    for series in times:
        half = len(series) // 2
        if not half:
            continue
        earlier, later = series[:half], series[-half:]
        if min(later) <= math.exp(LEAST_DEVIATION) * max(earlier):
            return None
        chance /= math.comb(2 * half, half)
        changes.append(math.log(fmean(later) / fmean(earlier)))
    return math.exp(fmean(changes)) if chance <= SLOWDOWN_LEVEL else None


def drift(times: Sequence[float]) -> float | None:
    """The mean of the second half of the `times` of a configuration's runs, in order, over that of the first.

    The middle one of an odd number is left out. None for fewer than two.
    """
    half = len(times) // 2
    return fmean(times[-half:]) / fmean(times[:half]) if half else None


def _quantile(quantiles: Sequence[float], degrees: int) -> float:
    return quantiles[min(degrees, len(quantiles)) - 1]
