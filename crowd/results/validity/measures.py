"""Measures of runs and sessions: pure functions over NumPy arrays, one run or session a row."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from wire.protocol import FIRST_COUNTED_FRAME, MAX_DRIFT, STAGE_SLACK_US, STAGE_TOLERANCE

CONFIDENCE = 0.95
# Two speedups agree if they differ no more than two repeats may.
AGREEMENT = math.log(MAX_DRIFT)
# These stages are not part of the computation, with which the sum of the stages is compared.
OUTSIDE_COMPUTATION = frozenset({"acquisition", "rendering", "total", "computation"})
# A series with so many different times does not occur twice by chance.
LEAST_DISTINCT_TIMES = 20
# A session farther from the median of its model is an outlier. In robust standard deviations.
OUTLIER_DEVIATIONS = 5.0


def mean_times(
    frame_us: NDArray[np.generic], first_counted_frame: int = FIRST_COUNTED_FRAME
) -> NDArray[np.float64]:
    """Arithmetic mean (n,) over the counted frames of each row of `frame_us` (n, frames), in its unit.

    Not the median: it would ignore periodic work, such as integrating every 24th frame. Raises ValueError if
    no frame is left.
    """
    counted = frame_us[:, first_counted_frame:]
    if counted.shape[1] == 0:
        raise ValueError(f"no frame is left from frame {first_counted_frame} on")
    means: NDArray[np.float64] = counted.mean(axis=1, dtype=np.float64)
    return means


def skipped_shares(skipped: NDArray[np.bool_], first_counted_frame: int) -> NDArray[np.float64]:
    """The share (n,) of the counted frames of each row of `skipped` (n, frames) that are; 0 without any."""
    counted = skipped[:, first_counted_frame:]
    shares: NDArray[np.float64] = counted.sum(axis=1, dtype=np.float64) / max(counted.shape[1], 1)
    return shares


def skipped_take_longer(
    frame_us: NDArray[np.generic], skipped: NDArray[np.bool_], first_counted_frame: int
) -> NDArray[np.bool_]:
    """Whether the median counted frame that a run left out took longer than the one that it computed, (n,).

    `frame_us` and `skipped` are (n, frames). False for a run that left out none of them, or all.
    """
    counted, left_out = frame_us[:, first_counted_frame:], skipped[:, first_counted_frame:]
    longer = np.zeros(len(counted), dtype=bool)
    for row in np.flatnonzero(left_out.any(axis=1) & ~left_out.all(axis=1)):
        series, out = counted[row], left_out[row]
        longer[row] = np.median(series[out]) > np.median(series[~out])
    return longer


def stages_exceed_frames(
    frame_us: NDArray[np.generic], names: Sequence[str], stages_us: NDArray[np.generic]
) -> NDArray[np.bool_]:
    """Whether the stages of the computation take longer than the frames, beyond the tolerance, (n,).

    `frame_us` is (n, frames). `stages_us` (n, stages * frames) holds the series of the stages `names` one
    after another.
    """
    inside = [index for index, name in enumerate(names) if name not in OUTSIDE_COMPUTATION]
    if not inside:
        return np.zeros(len(frame_us), dtype=bool)
    series = stages_us.reshape(len(frame_us), len(names), -1)
    slack = STAGE_SLACK_US * series.shape[2]
    total = series[:, inside].sum(axis=(1, 2), dtype=np.float64)
    exceeding: NDArray[np.bool_] = total > frame_us.sum(axis=1, dtype=np.float64) * STAGE_TOLERANCE + slack
    return exceeding


def distinct_times(frame_us: NDArray[np.generic]) -> NDArray[np.int64]:
    """How many different times each row of `frame_us` (n, frames) has."""
    ordered = np.sort(frame_us, axis=1)
    changes = np.count_nonzero(ordered[:, 1:] != ordered[:, :-1], axis=1)
    distinct: NDArray[np.int64] = changes + min(frame_us.shape[1], 1)
    return distinct


def complete_pairs(baseline: Mapping[int, int], candidate: Mapping[int, int], planned_repeats: int) -> bool:
    """Whether the common repeats are 0, 1, 2, ... without a gap, and at least `planned_repeats`.

    `baseline` and `candidate` map repeats to positions in the session, for the runs that count. One of them
    may have more repeats, because a session may be interrupted.
    """
    both = baseline.keys() & candidate.keys()
    return len(both) >= planned_repeats and both == set(range(len(both)))


def balanced_order(baseline: Mapping[int, int], candidate: Mapping[int, int]) -> bool:
    """Whether a steady drift cancels in the mean over the pairs of `baseline` and `candidate`.

    Arguments as in `complete_pairs`. For an even number of pairs, both must have the same mean position. For
    an odd number that is impossible: one pair may be left over.
    """
    distances = [candidate[repeat] - baseline[repeat] for repeat in baseline.keys() & candidate.keys()]
    left_over = max(map(abs, distances), default=0) if len(distances) % 2 else 0
    return abs(sum(distances)) <= left_over
