"""From frames to the crowd's figure: pure functions over NumPy arrays.

The chain, each level averaged before the next so that nobody counts twice: frames -> run (mean) -> session
(mean of paired log ratios) -> installation (mean) -> device model (mean, t interval over installations) ->
crowd (geometric mean over models). Frames are no replicates of a run, nor sessions of an installation: an
interval over either covers the truth far too seldom.
"""

import math
from collections import Counter
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slam.protocol import FIRST_COUNTED_FRAME, MAX_DRIFT

# Stored on every summary; raise it with any change of a figure below, and everything is computed again.
ALGORITHM = 2
CONFIDENCE = 0.95
LEAST_INSTALLATIONS = 3
LEAST_SESSIONS = 3
LEAST_MODELS = 3
SESSIONS_PER_DAY = 5
# Clocks of stages and of the frame are read apart: 5 % and 50 us of a frame may be lost between them.
STAGE_TOLERANCE = 1.05
STAGE_SLACK_US = 50
# What the stages' sum is compared with is the computation; these two lie outside it.
OUTSIDE_COMPUTATION = frozenset({"acquisition", "rendering", "total", "computation"})
# 20,000 frames a second: launching a frame's kernels alone takes longer.
SHORTEST_MEAN_US = 50.0
# So many different times do not come twice in the same order by chance.
LEAST_DISTINCT_TIMES = 20
# Before the clock is said to have fallen, each third of a session has two readings.
LEAST_READINGS = 6
OUTLIER_DEVIATIONS = 5.0
# The median absolute deviation of normal values, times this, estimates their standard deviation.
NORMAL_MAD = 1.4826
# Installations of one model differ by a tenth without any fault, and of few the deviation may be 0 by chance.
LEAST_DEVIATION = math.log(1.1)
# Two installations agree that are as near to each other as two repeats have to be.
AGREEMENT = math.log(MAX_DRIFT)


def run_value(frame_us: ArrayLike, first_counted_frame: int = FIRST_COUNTED_FRAME) -> float:
    """Arithmetic mean of the counted frames, in the unit given. Raises ValueError where none is left.

    The mean and not the median: configurations do periodic work, such as integrating every 24th frame, that
    a median would drop.
    """
    counted = np.asarray(frame_us, dtype=np.float64)[first_counted_frame:]
    if counted.size == 0:
        raise ValueError(f"no frame is left from frame {first_counted_frame} on")
    return float(counted.mean())


def paired_log_ratios(baseline: Mapping[int, float], candidate: Mapping[int, float]) -> NDArray[np.float64]:
    """log(baseline / candidate) of each repeat that both have, (n,), in order of the repeats.

    In the order default, best, best, default the drift of a device that steadily warms up enters the two
    ratios with opposite signs, so that their mean is free of it.
    """
    repeats = sorted(set(baseline) & set(candidate))
    return np.array([math.log(baseline[repeat] / candidate[repeat]) for repeat in repeats])


def drift(
    first_us: ArrayLike, last_us: ArrayLike, first_counted_frame: int = FIRST_COUNTED_FRAME
) -> float | None:
    """Median over the counted frames of last / first repeat of one configuration; None without frames.

    Like is compared with like: the first and the last third of one run would confound the scene with the
    heat.
    """
    first = np.asarray(first_us, dtype=np.float64)[first_counted_frame:]
    last = np.asarray(last_us, dtype=np.float64)[first_counted_frame:]
    length = min(first.size, last.size)
    timed = (first[:length] > 0) & (last[:length] > 0)
    if not timed.any():
        return None
    return float(np.median(last[:length][timed] / first[:length][timed]))


def drifts(
    first_us: NDArray[np.uint32],
    last_us: NDArray[np.uint32],
    first_counted_frame: int = FIRST_COUNTED_FRAME,
) -> list[float | None]:
    """`drift` of each row of FIRST_US (n, frames) with that of LAST_US (n, frames)."""
    first, last = first_us[:, first_counted_frame:], last_us[:, first_counted_frame:]
    timed = np.all((first > 0) & (last > 0), axis=1)
    found = [
        None if whole else drift(one, other, 0)
        for one, other, whole in zip(first, last, timed.tolist(), strict=True)
    ]
    if first.size:
        medians = np.median(last[timed] / first[timed].astype(np.float64), axis=1).tolist()
        for place, median in zip(np.flatnonzero(timed).tolist(), medians, strict=True):
            found[place] = median
    return found


def clock_fall(readings_mhz: Sequence[float]) -> float | None:
    """Median clock of the first third of the readings over that of the last; None for too few of them."""
    if len(readings_mhz) < LEAST_READINGS:
        return None
    third = len(readings_mhz) // 3
    first, last = np.median(readings_mhz[:third]), np.median(readings_mhz[-third:])
    return float(first / last) if last > 0 else None


def stages_exceed_frames(frame_us: ArrayLike, stages_us: Mapping[str, ArrayLike]) -> bool:
    """Whether the computation's stages take longer than the computation, beyond the clocks' tolerance."""
    inside = [
        np.asarray(series, dtype=np.float64)
        for name, series in stages_us.items()
        if name not in OUTSIDE_COMPUTATION
    ]
    if not inside:
        return False
    total = np.sum(inside, axis=0)
    return bool(
        total.sum()
        > np.asarray(frame_us, dtype=np.float64).sum() * STAGE_TOLERANCE + STAGE_SLACK_US * total.size
    )


def all_stages_exceed_frames(
    frame_us: NDArray[np.uint32], names: Sequence[str], stages_us: NDArray[np.uint32]
) -> NDArray[np.bool_]:
    """`stages_exceed_frames` of each row of FRAME_US (n, frames): STAGES_US (n, stages * frames) holds the
    series of the stages called NAMES one after another.
    """
    inside = [place for place, name in enumerate(names) if name not in OUTSIDE_COMPUTATION]
    if not inside:
        return np.zeros(len(frame_us), dtype=bool)
    series = stages_us.reshape(len(frame_us), len(names), -1)
    slack = STAGE_SLACK_US * series.shape[2]
    total = series[:, inside].sum(axis=(1, 2), dtype=np.float64)
    exceeding: NDArray[np.bool_] = total > frame_us.sum(axis=1, dtype=np.float64) * STAGE_TOLERANCE + slack
    return exceeding


def distinct_times(frame_us: NDArray[np.uint32]) -> NDArray[np.int64]:
    """How many different times each row of FRAME_US (n, frames) has."""
    ordered = np.sort(frame_us, axis=1)
    changes = np.count_nonzero(ordered[:, 1:] != ordered[:, :-1], axis=1)
    return changes + min(frame_us.shape[1], 1)


def ratio(log_ratio: float) -> float:
    """The speedup behind a log ratio."""
    return math.exp(log_ratio)


def geometric_mean(ratios: Sequence[float]) -> float:
    """Of one ratio or more. Never an arithmetic mean of ratios."""
    return math.exp(math.fsum(map(math.log, ratios)) / len(ratios))


@dataclass(frozen=True)
class Interval:
    """A ratio with its confidence interval; low and high are None where no interval is due."""

    value: float
    low: float | None
    high: float | None


def geometric_interval(logs: Sequence[float], least: int) -> Interval:
    """exp of the mean of LOGS, with a two-sided t interval of CONFIDENCE from LEAST values on.

    Raises ValueError for no values at all.
    """
    if not logs:
        raise ValueError("a mean of no values")
    values = np.asarray(logs, dtype=np.float64)
    deviation = float(values.std(ddof=1)) if values.size > 1 else 0.0
    return _interval(float(values.mean()), deviation, values.size, least)


def _interval(mean: float, deviation: float, count: int, least: int) -> Interval:
    if count < max(least, 2):
        return Interval(math.exp(mean), None, None)
    # scipy.stats takes a second to import, and the web process has no other use of it.
    from scipy.special import stdtrit

    half = float(stdtrit(count - 1, (1 + CONFIDENCE) / 2)) * deviation / math.sqrt(count)
    return Interval(math.exp(mean), math.exp(mean - half), math.exp(mean + half))


def within_daily_limit(keys: Iterable[Hashable]) -> list[bool]:
    """Of each key, in the given order, whether it is among the first SESSIONS_PER_DAY of its kind.

    A key says whose session it is, of which day, and what for.
    """
    seen: Counter[Hashable] = Counter()
    counted = []
    for key in keys:
        seen[key] += 1
        counted.append(seen[key] <= SESSIONS_PER_DAY)
    return counted


@dataclass(frozen=True)
class InstallationValue:
    """One installation: mean and standard deviation (0 for one session) of its sessions' log ratios."""

    log_ratio: float
    deviation: float
    sessions: int


@dataclass(frozen=True)
class ModelSpeedup:
    """A device model's speedup. `repeat` is the repeatability on the one installation there is, else None."""

    speedup: Interval
    repeat: Interval | None
    sessions: int
    installations: int


def model_speedup(installations: Sequence[InstallationValue]) -> ModelSpeedup:
    """The mean over INSTALLATIONS, each weighing the same however many sessions it sent.

    Raises ValueError for no installation.
    """
    repeat = None
    if len(installations) == 1 and installations[0].sessions >= LEAST_SESSIONS:
        only = installations[0]
        repeat = _interval(only.log_ratio, only.deviation, only.sessions, LEAST_SESSIONS)
    return ModelSpeedup(
        speedup=geometric_interval([each.log_ratio for each in installations], LEAST_INSTALLATIONS),
        repeat=repeat,
        sessions=sum(each.sessions for each in installations),
        installations=len(installations),
    )


def usual_range(installations: Sequence[float]) -> tuple[float, float] | None:
    """Between which log ratios a session is no outlier, of one model's INSTALLATIONS; None for too few.

    OUTLIER_DEVIATIONS robust standard deviations around the median (Leys et al. 2013): unlike mean and
    standard deviation, neither follows the outlier.
    """
    if len(installations) < LEAST_INSTALLATIONS:
        return None
    values = np.asarray(installations, dtype=np.float64)
    median = float(np.median(values))
    deviation = NORMAL_MAD * float(np.median(np.abs(values - median)))
    reach = OUTLIER_DEVIATIONS * max(deviation, LEAST_DEVIATION)
    return median - reach, median + reach


def without_agreement(sessions: Sequence[tuple[Hashable, float]]) -> list[bool]:
    """Of each session (installation, log ratio), whether no other installation has one within AGREEMENT."""
    order = sorted(range(len(sessions)), key=lambda place: sessions[place][1])
    alone = [True] * len(sessions)
    for direction in (order, order[::-1]):
        nearest: dict[Hashable, float] = {}  # of the last two installations that were met, the nearest value
        for place in direction:
            installation, value = sessions[place]
            others = [known for other, known in nearest.items() if other != installation]
            if any(abs(value - known) <= AGREEMENT for known in others):
                alone[place] = False
            nearest.pop(installation, None)
            nearest[installation] = value
            if len(nearest) > 2:
                del nearest[next(iter(nearest))]
    return alone


def crowd_speedup(speedups: Sequence[float]) -> Interval | None:
    """Unweighted geometric mean over device models, with an interval over them; None for none."""
    return geometric_interval([math.log(speedup) for speedup in speedups], LEAST_MODELS) if speedups else None
