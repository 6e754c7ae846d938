"""The statistics of sessions against figures worked out by hand, and against simulated sessions."""

import math
from collections.abc import Callable, Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import stats

from wire import session_statistics
from wire.protocol import PAIRS
from wire.session_statistics import PROCESSOR, PROCESSOR_DEVIATION, WALL, RunTime

TIMES = st.lists(st.floats(1e-3, 1e3), min_size=4, max_size=4)
Times = NDArray[np.float64]
# Seconds of the runs of default and best; the order of a session.
SECONDS = {"default": 8.0, "best": 1.0}
ORDER = ("default", "best", "best", "default") * (PAIRS // 2)


def test_the_quantiles_are_students() -> None:
    degrees = np.arange(1, 25)

    assert pytest.approx(stats.t.ppf(0.975, degrees), abs=6e-4) == session_statistics.QUANTILES_95
    assert pytest.approx(stats.t.ppf(0.995, degrees), abs=6e-4) == session_statistics.QUANTILES_99


def test_a_steady_drift_cancels_in_the_order_default_best_best_default() -> None:
    warm = [1.0, 1.1, 1.21, 1.331]  # each run 10 % slower than the one before

    ratios = session_statistics.paired_log_ratios(
        {0: 80 * warm[0], 1: 80 * warm[3]}, {0: 10 * warm[1], 1: 10 * warm[2]}
    )

    assert math.exp(np.mean(ratios)) == pytest.approx(8.0)


def test_only_repeats_that_both_have_are_paired() -> None:
    pairs = session_statistics.paired_log_ratios

    assert pairs({0: 4.0, 1: 4.0}, {1: 2.0, 2: 1.0}) == pytest.approx([math.log(2)])
    assert pairs({0: 4.0}, {1: 2.0}) == []


@given(TIMES, TIMES)
def test_swapping_default_and_best_inverts_the_speedup(default: list[float], best: list[float]) -> None:
    runs = dict(enumerate(default)), dict(enumerate(best))

    there, back = (
        session_statistics.speedup(session_statistics.paired_log_ratios(*pair)) for pair in (runs, runs[::-1])
    )

    assert there is not None
    assert back is not None
    assert there.value * back.value == pytest.approx(1.0)
    assert there.changed == back.changed


def test_a_session_has_a_t_interval_over_its_pairs() -> None:
    logs = [2.0, 2.1, 1.9, 2.05]

    low, high = stats.t.interval(0.95, 3, loc=np.mean(logs), scale=stats.sem(logs))

    four, two = session_statistics.speedup(logs), session_statistics.speedup([2.0, 2.1])
    assert four is not None
    assert two is not None
    assert four.interval == pytest.approx((low, high), abs=1e-4)
    assert two.interval is None


def test_a_speedup_that_changes_is_distinguished_from_one_that_wavers() -> None:
    changes = session_statistics.speedup_changes

    assert changes([2.0, 2.01, 1.65, 1.66])
    assert not changes([2.0, 1.65, 1.66, 2.01])
    assert not changes([2.0, 2.001, 1.8, 1.801])  # four pairs that repeat so well do so by chance
    assert not changes([2.0, 1.65])
    assert changes([2.0, 2.01, 2.0, 5.0, 1.8, 1.81, 1.8])  # the middle one belongs to neither half


def test_drift_compares_the_means_of_whole_runs() -> None:
    assert session_statistics.drift([10.0, 11.0, 12.0, 13.2]) == pytest.approx(1.2)
    assert session_statistics.drift([10.0, 99.0, 12.0]) == pytest.approx(1.2)
    assert session_statistics.drift([10.0]) is None


def noise(share: float) -> Callable[[np.random.Generator, Times], Times]:
    """Each run is slowed or sped up by a normal `share` of its own."""
    return lambda random, begins: np.exp(random.normal(0.0, share, begins.shape))


def bursts(share: float) -> Callable[[np.random.Generator, Times], Times]:
    """Other work that slows all by half for `share` of the time, in bursts of half a default run each."""

    def slowed(random: np.random.Generator, begins: Times) -> Times:
        cells = 20 * int(begins[0, -1] + SECONDS["default"])  # of 1/20 s
        length = int(10 * SECONDS["default"])
        starts = random.random((len(begins), cells)) < -math.log1p(-share) / length
        running = np.cumsum(starts, axis=1)
        busy = (running - np.pad(running, ((0, 0), (length, 0)))[:, :cells]) > 0
        factors = []
        for begin, name in zip((20 * begins[0]).astype(int), ORDER, strict=True):
            factors.append(1 + 0.5 * busy[:, begin : begin + int(20 * SECONDS[name])].mean(axis=1))
        return np.stack(factors, axis=1) * noise(0.01)(random, begins)

    return slowed


def throttling(share: float) -> Callable[[np.random.Generator, Times], Times]:
    """A device that gets slower by `share` exponentially, faster or slower than the session."""

    def slowed(random: np.random.Generator, begins: Times) -> Times:
        pace = random.uniform(0.2, 2.0, (len(begins), 1)) * begins[0, -1]
        return (1 + share * (1 - np.exp(-begins / pace))) * noise(0.01)(random, begins)

    return slowed


def one_burst(random: np.random.Generator, begins: Times) -> Times:
    """Other work that slows one to three runs by half, one after another, anywhere in the session."""
    order = np.arange(begins.shape[1])
    length = random.integers(1, 4, (len(begins), 1))
    first = random.integers(0, len(order) - length + 1)
    busy = (order >= first) & (order < first + length)
    return (1 + 0.5 * busy) * noise(0.01)(random, begins)


def step(random: np.random.Generator, begins: Times) -> Times:
    """A device that gets slower by 1.4 in the middle of the session."""
    return np.where(begins < begins[:, [-1]] / 2, 1.0, 1.4) * noise(0.01)(random, begins)


TRACES = {
    **{f"noise of {share:.0%}": noise(share) for share in (0.01, 0.05, 0.06, 0.08, 0.10, 0.15)},
    **{f"bursts in {share:.0%}": bursts(share) for share in (0.06, 0.15, 0.18)},
    **{f"throttling to {share:.0%}": throttling(share) for share in (0.1, 0.2, 0.3)},
    "a step of 1.4": step,
}


def run_times(trace: Callable[[np.random.Generator, Times], Times], sessions: int) -> tuple[Times, Times]:
    """The times of the runs of default and of best in so many `sessions`, seed 3."""
    ends = np.cumsum([SECONDS[name] for name in ORDER])
    begins = np.tile(ends - [SECONDS[name] for name in ORDER], (sessions, 1))
    times = trace(np.random.default_rng(3), begins) * [SECONDS[name] for name in ORDER]
    default, best = (times[:, [each == name for each in ORDER]] for name in ("default", "best"))
    return default, best


def log_ratios(trace: Callable[[np.random.Generator, Times], Times], sessions: int) -> list[Sequence[float]]:
    """The paired log ratios of so many `sessions`, seed 3."""
    default, best = run_times(trace, sessions)
    return np.log(default / best).tolist()


@pytest.mark.slow
@pytest.mark.parametrize("count", [5_000, pytest.param(20_000, marks=pytest.mark.exhaustive)])
@pytest.mark.parametrize("trace", TRACES.values(), ids=TRACES)
def test_of_honest_sessions_fewer_than_one_in_twenty_are_set_aside(
    trace: Callable[[np.random.Generator, Times], Times], count: int
) -> None:
    """docs/research/coverage.md has what came out of 20,000 sessions each."""
    sessions = log_ratios(trace, count)

    assert np.mean([session_statistics.speedup_changes(logs) for logs in sessions]) < 0.05


STEADY = {
    **{f"noise of {share:.0%}": noise(share) for share in (0.01, 0.08, 0.10, 0.15)},
    **{f"bursts in {share:.0%}": bursts(share) for share in (0.06, 0.18)},
    "one burst": one_burst,
}
SLOWER = {"throttling to 30%": (throttling(0.3), 0.7), "a step of 1.4": (step, 0.95)}


def told(trace: Callable[[np.random.Generator, Times], Times]) -> float:
    """The share of 2,000 sessions with a reported slowdown."""
    sessions = zip(*run_times(trace, 2_000), strict=True)
    slowdowns = [session_statistics.slowed_down([list(each) for each in times]) for times in sessions]
    return np.mean([slower is not None for slower in slowdowns]).item()


@pytest.mark.parametrize("trace", STEADY.values(), ids=STEADY)
def test_a_slowdown_is_told_of_at_most_one_in_twenty_steady_devices(
    trace: Callable[[np.random.Generator, Times], Times],
) -> None:
    assert told(trace) <= 0.05


@pytest.mark.parametrize(("trace", "least"), SLOWER.values(), ids=SLOWER)
def test_a_slowdown_that_lasts_is_told(
    trace: Callable[[np.random.Generator, Times], Times], least: float
) -> None:
    assert told(trace) >= least


def test_a_slowdown_is_told_where_all_configurations_show_it_to_the_end() -> None:
    slowed_down = session_statistics.slowed_down
    slower = [10.0, 10.1, 12.9, 13.1]

    assert slowed_down([slower, [1.0, 1.0, 1.3, 1.3]]) == pytest.approx(1.297, abs=1e-3)
    assert slowed_down([slower, [1.0, 1.0, 1.0, 1.0]]) is None
    assert slowed_down([[10.0, 10.1, 13.0, 10.0], [1.0, 1.0, 1.3, 1.3]]) is None
    assert slowed_down([slower]) is None  # one in six by chance
    assert slowed_down([slower, [1.0]]) is None
    assert slowed_down([[10.0, 10.1, 10.2, 10.3], [1.0, 1.01, 1.02, 1.03]]) is None  # too little
    assert slowed_down([]) is None


@pytest.mark.parametrize(
    ("low", "high", "wide"), [(5.3, 23.3, True), (4.0, 6.0, False), (4.0, 6.01, True), (None, None, False)]
)
def test_an_interval_is_wide_from_a_ratio_of_one_and_a_half_on(
    low: float | None, high: float | None, wide: bool
) -> None:
    assert session_statistics.wide_range(low, high) == ((low, high) if wide else None)


def test_of_sessions_whose_speedup_changes_half_way_most_are_set_aside() -> None:
    """Twice as fast, on a device with noise of 1 %."""
    changed = np.array([0.0, 0.0, math.log(2), math.log(2)])
    quiet = np.array(log_ratios(noise(0.01), 2_000)) + changed

    assert np.mean([session_statistics.speedup_changes(logs) for logs in quiet.tolist()]) > 0.9


# Mean microseconds of a frame of the default and of best, beside two loops and on two idle cores.
BUSY = RunTime(18_092, 18_575, 19_016), RunTime(1_130, 1_262, 1_440)
IDLE = RunTime(10_206, 18_958, 968), RunTime(1_022, 1_353, 886)


def test_a_run_whose_threads_waited_for_a_processor_is_contended() -> None:
    """Half of their processor time is much for long frames, and usual for short ones."""
    waiting = [RunTime(20_000, 20_000, 10_000), RunTime(3_700, 5_300, 3_400)]

    assert session_statistics.contended([BUSY[0], IDLE[0]]) == [True, False]
    assert session_statistics.contended([BUSY[1], IDLE[1]]) == [True, False]
    assert session_statistics.contended(waiting) == [True, False]


def test_where_waiting_is_unknown_fewer_busy_cores_than_in_another_run_are_contention() -> None:
    cores = [1.9, 1.8, 1.5]

    assert session_statistics.contended([RunTime(1e6, 1e6 * core, None) for core in cores]) == [
        False, False, True,
    ]  # fmt: skip


@pytest.mark.parametrize("cores", [[0.2, 0.1], [None, None]])
def test_of_a_gpu_or_an_unknown_processor_nothing_is_said(cores: list[float | None]) -> None:
    times = [RunTime(1e6, None if core is None else 1e6 * core, None) for core in cores]

    assert session_statistics.contended(times) == [False, False]


def compared(default: RunTime, best: RunTime, on_processor: bool = True) -> session_statistics.Speedup:
    """Four pairs, the last of them of the runs `default` and `best`, the others of idle cores."""
    found = session_statistics.compare(
        dict(enumerate([IDLE[0]] * 3 + [default])), dict(enumerate([IDLE[1]] * 3 + [best])), on_processor
    )
    assert found is not None
    return found


def test_where_other_programs_ran_processor_times_are_compared_with_their_own_error() -> None:
    undisturbed, disturbed = compared(*IDLE), compared(*BUSY)

    assert (undisturbed.clock, disturbed.clock) == (WALL, PROCESSOR)
    assert undisturbed.value == pytest.approx(IDLE[0].wall_us / IDLE[1].wall_us)
    logs = [math.log(18_958 / 1_353)] * 3 + [math.log(18_575 / 1_262)]
    assert disturbed.log == pytest.approx(np.mean(logs))
    assert disturbed.interval is not None
    half = (disturbed.interval[1] - disturbed.interval[0]) / 2
    assert half == pytest.approx(math.hypot(3.182 * stats.sem(logs), 1.96 * PROCESSOR_DEVIATION), rel=1e-3)
    assert not disturbed.contended


def test_a_graphics_chip_or_an_unknown_time_leaves_no_interval_beside_other_programs() -> None:
    unknown = RunTime(1_022, None, None)

    for found in (compared(*BUSY, on_processor=False), compared(BUSY[0], unknown)):
        assert (found.clock, found.contended, found.interval) == (WALL, True, None)
