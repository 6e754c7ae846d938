"""Measures of runs and sessions: pure functions over NumPy arrays, one run or session a row."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slam.protocol import FIRST_COUNTED_FRAME, LEAST_PAIRS, MAX_DRIFT

CONFIDENCE = 0.95
# Two speedups agree if they differ no more than two repeats may.
AGREEMENT = math.log(MAX_DRIFT)
# Stages and frames are timed separately: they may differ by 5 % and 50 us a frame.
STAGE_TOLERANCE = 1.05
STAGE_SLACK_US = 50
# These stages are not part of the computation, with which the sum of the stages is compared.
OUTSIDE_COMPUTATION = frozenset({"acquisition", "rendering", "total", "computation"})
# 20,000 frames a second: launching the kernels of a frame already takes longer.
SHORTEST_MEAN_US = 50.0
# A series with so many different times does not occur twice by chance.
LEAST_DISTINCT_TIMES = 20
# A session farther from the median of its model is an outlier. In robust standard deviations.
OUTLIER_DEVIATIONS = 5.0
# Each third of a session needs two readings of the clock.
LEAST_READINGS = 6


def mean_times(
    frame_us: NDArray[np.generic], first_counted_frame: int = FIRST_COUNTED_FRAME
) -> NDArray[np.float64]:
    """Arithmetic mean (n,) over the counted frames of each row of FRAME_US (n, frames), in its unit.

    Not the median: it would ignore periodic work, such as integrating every 24th frame. Raises ValueError if
    no frame is left.
    """
    counted = frame_us[:, first_counted_frame:]
    if counted.shape[1] == 0:
        raise ValueError(f"no frame is left from frame {first_counted_frame} on")
    means: NDArray[np.float64] = counted.mean(axis=1, dtype=np.float64)
    return means


def paired_log_ratios(baseline: Mapping[int, float], candidate: Mapping[int, float]) -> NDArray[np.float64]:
    """log(baseline / candidate) of each repeat that both have, (n,), in the order of the repeats.

    In the order default, best, best, default the drift of a device that warms up steadily enters the two
    ratios with opposite signs, so that it cancels in their mean.
    """
    repeats = sorted(set(baseline) & set(candidate))
    return np.array([math.log(baseline[repeat] / candidate[repeat]) for repeat in repeats])


def drifts(
    earlier_us: NDArray[np.generic],
    later_us: NDArray[np.generic],
    first_counted_frame: int = FIRST_COUNTED_FRAME,
) -> list[float | None]:
    """Median over the counted frames of later / earlier repeats, by row of both (n, repeats, frames).

    A frame's times are averaged over the repeats of each side, so that a single delay is not a drift. Frames
    without a time are left out; None if no frame is left. Equal frames are compared: the first and last third
    of one run would differ by the scene, too.
    """
    earlier = earlier_us[:, :, first_counted_frame:].astype(np.float64)
    later = later_us[:, :, first_counted_frame:].astype(np.float64)
    first, last = earlier.mean(axis=1), later.mean(axis=1)
    timed = (earlier.min(axis=1) > 0) & (later.min(axis=1) > 0)
    whole, some = timed.all(axis=1), timed.any(axis=1)
    found: list[float | None] = [None] * len(first)
    if first.size:
        medians = np.median(last[whole] / first[whole], axis=1)
        for row, median in zip(np.flatnonzero(whole).tolist(), medians.tolist(), strict=True):
            found[row] = median
    for row in np.flatnonzero(some & ~whole).tolist():
        kept = timed[row]
        found[row] = float(np.median(last[row, kept] / first[row, kept]))
    return found


def has_drifted(drift: float | None) -> bool:
    """Whether the later repeats took much more or much less time than the earlier ones."""
    return drift is not None and abs(math.log(drift)) > math.log(MAX_DRIFT)


def clock_fall(readings_mhz: Sequence[float]) -> float | None:
    """Median clock of the first third of READINGS_MHZ over that of the last; None for too few readings."""
    if len(readings_mhz) < LEAST_READINGS:
        return None
    third = len(readings_mhz) // 3
    first, last = np.median(readings_mhz[:third]), np.median(readings_mhz[-third:])
    return float(first / last) if last > 0 else None


def stages_exceed_frames(
    frame_us: NDArray[np.generic], names: Sequence[str], stages_us: NDArray[np.generic]
) -> NDArray[np.bool_]:
    """Whether the stages of the computation take longer than the frames, beyond the tolerance, (n,).

    FRAME_US is (n, frames). STAGES_US (n, stages * frames) holds the series of the stages NAMES one after
    another.
    """
    inside = [place for place, name in enumerate(names) if name not in OUTSIDE_COMPUTATION]
    if not inside:
        return np.zeros(len(frame_us), dtype=bool)
    series = stages_us.reshape(len(frame_us), len(names), -1)
    slack = STAGE_SLACK_US * series.shape[2]
    total = series[:, inside].sum(axis=(1, 2), dtype=np.float64)
    exceeding: NDArray[np.bool_] = total > frame_us.sum(axis=1, dtype=np.float64) * STAGE_TOLERANCE + slack
    return exceeding


def distinct_times(frame_us: NDArray[np.generic]) -> NDArray[np.int64]:
    """How many different times each row of FRAME_US (n, frames) has."""
    ordered = np.sort(frame_us, axis=1)
    changes = np.count_nonzero(ordered[:, 1:] != ordered[:, :-1], axis=1)
    return changes + min(frame_us.shape[1], 1)


def complete_pairs(baseline: Mapping[int, int], candidate: Mapping[int, int], planned_repeats: int) -> bool:
    """Whether the common repeats are 0, 1, 2, ... without a gap, and at least PLANNED_REPEATS.

    BASELINE and CANDIDATE map repeats to positions in the session, for the runs that count. One of them may
    have more repeats, because a session may be interrupted.
    """
    both = baseline.keys() & candidate.keys()
    return len(both) >= planned_repeats and both == set(range(len(both)))


def balanced_order(baseline: Mapping[int, int], candidate: Mapping[int, int]) -> bool:
    """Whether a steady drift cancels in the mean over the pairs of BASELINE and CANDIDATE.

    Arguments as in `complete_pairs`. For an even number of pairs, both must have the same mean position. For
    an odd number that is impossible: one pair may be left over.
    """
    distances = [candidate[repeat] - baseline[repeat] for repeat in baseline.keys() & candidate.keys()]
    left_over = max(map(abs, distances), default=0) if len(distances) % 2 else 0
    return abs(sum(distances)) <= left_over


def t_quantile(degrees: float, alpha: float) -> float:
    """The two-sided quantile of Student's t with ALPHA outside."""
    # scipy.stats takes a second to import, and the web process does not use it otherwise.
    from scipy.special import stdtrit

    return float(stdtrit(degrees, 1 - alpha / 2))


def session_interval(log_ratios: ArrayLike) -> tuple[float, float] | None:
    """The 95 % t interval (low, high) of a session's mean log ratio over its pairs (n,).

    None for fewer than LEAST_PAIRS.
    """
    values = np.asarray(log_ratios, dtype=np.float64)
    if values.size < LEAST_PAIRS:
        return None
    quantile = t_quantile(values.size - 1, 1 - CONFIDENCE)
    half = quantile * float(values.std(ddof=1)) / math.sqrt(values.size)
    mean = float(values.mean())
    return mean - half, mean + half
