"""From frames to the crowd's figure: pure functions over NumPy arrays.

The chain, each level averaged before the next so that nobody counts twice: frames -> run (mean) -> session
(mean of paired log ratios) -> installation (mean) -> device model (mean, t interval over installations) ->
crowd (geometric mean over models). Frames are no replicates of a run, nor sessions of an installation: an
interval over either covers the truth far too seldom.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import date

import numpy as np
from numpy.typing import ArrayLike, NDArray

# Stored on every summary; raise it with any change of a figure below, and everything is computed again.
ALGORITHM = 1
FIRST_COUNTED_FRAME = 10
MAX_ATE = 0.05
MAX_DRIFT = 1.15
CONFIDENCE = 0.95
LEAST_INSTALLATIONS = 3
LEAST_SESSIONS = 3
SESSIONS_PER_DAY = 5
# Clocks of stages and of the frame are read apart: 5 % and 50 us of a frame may be lost between them.
STAGE_TOLERANCE = 1.05
STAGE_SLACK_US = 50
# What the stages' sum is compared with is the computation; these two lie outside it.
OUTSIDE_COMPUTATION = frozenset({"acquisition", "rendering", "total", "computation"})


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
    first_us: ArrayLike, second_us: ArrayLike, first_counted_frame: int = FIRST_COUNTED_FRAME
) -> float | None:
    """Median over the counted frames of second / first repeat of one configuration; None without frames.

    Like is compared with like: the first and the last third of one run would confound the scene with the
    heat.
    """
    first = np.asarray(first_us, dtype=np.float64)[first_counted_frame:]
    second = np.asarray(second_us, dtype=np.float64)[first_counted_frame:]
    length = min(first.size, second.size)
    timed = (first[:length] > 0) & (second[:length] > 0)
    if not timed.any():
        return None
    return float(np.median(second[:length][timed] / first[:length][timed]))


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


def ratio(log_ratio: float) -> float:
    """The speedup behind a log ratio."""
    return math.exp(log_ratio)


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
    centre = float(values.mean())
    if values.size < least:
        return Interval(math.exp(centre), None, None)
    # scipy.stats takes a second to import, and the web process has no other use of it.
    from scipy.special import stdtrit

    quantile = float(stdtrit(values.size - 1, (1 + CONFIDENCE) / 2))
    half = quantile * float(values.std(ddof=1)) / math.sqrt(values.size)
    return Interval(math.exp(centre), math.exp(centre - half), math.exp(centre + half))


@dataclass(frozen=True)
class SessionValue:
    """One session's log ratio, with who measured it and when."""

    installation: object
    day: date
    log_ratio: float


@dataclass(frozen=True)
class ModelSpeedup:
    """A device model's speedup. `repeat` is the repeatability on the one installation there is, else None."""

    speedup: Interval
    repeat: Interval | None
    sessions: int
    installations: int


def model_speedup(sessions: Iterable[SessionValue]) -> ModelSpeedup:
    """Sessions of one device model, averaged within each installation, then over installations.

    At most SESSIONS_PER_DAY sessions of an installation and day count, the first of them in the given order.
    Raises ValueError for no session.
    """
    by_installation: dict[object, list[float]] = {}
    days: dict[tuple[object, date], int] = {}
    for session in sessions:
        seen = days.get((session.installation, session.day), 0)
        if seen < SESSIONS_PER_DAY:
            days[session.installation, session.day] = seen + 1
            by_installation.setdefault(session.installation, []).append(session.log_ratio)
    means = [float(np.mean(logs)) for logs in by_installation.values()]
    only = next(iter(by_installation.values())) if len(by_installation) == 1 else []
    return ModelSpeedup(
        speedup=geometric_interval(means, LEAST_INSTALLATIONS),
        repeat=geometric_interval(only, LEAST_SESSIONS) if len(only) >= LEAST_SESSIONS else None,
        sessions=sum(days.values()),
        installations=len(by_installation),
    )


def crowd_speedup(speedups: Sequence[float]) -> float | None:
    """Unweighted geometric mean over device models, None for none. Never an arithmetic mean of ratios."""
    return None if not speedups else float(np.exp(np.mean(np.log(speedups))))
