"""What is computed of runs and sessions, against figures that can be worked out by hand."""

import math
from collections.abc import Iterable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from crowd.results.validity import measures

TIMES = st.lists(st.integers(1, 10**6), min_size=100, max_size=100)


def mean_time(times: list[int]) -> float:
    return float(measures.mean_times(np.array([times]))[0])


def places(order: Iterable[str], name: str) -> dict[int, int]:
    """The places of the runs of NAME in ORDER, by repeat."""
    return dict(enumerate(place for place, each in enumerate(order) if each == name))


def test_the_first_ten_frames_do_not_count() -> None:
    assert mean_time([10**6] * 10 + [3] * 90) == 3


def test_periodic_work_counts_in_full() -> None:
    """A median would say 1 of a configuration that works 100 every tenth frame."""
    assert mean_time(([1] * 9 + [100]) * 10) == pytest.approx(10.9)


def test_a_run_without_counted_frames_has_no_mean() -> None:
    with pytest.raises(ValueError, match="from frame 10 on"):
        mean_time([1] * 10)


def test_a_steady_drift_cancels_in_the_order_default_best_best_default() -> None:
    warm = [1.0, 1.1, 1.21, 1.331]  # each run 10 % slower than the one before

    ratios = measures.paired_log_ratios(
        {0: 80 * warm[0], 1: 80 * warm[3]}, {0: 10 * warm[1], 1: 10 * warm[2]}
    )

    assert math.exp(ratios.mean()) == pytest.approx(8.0)


def test_only_repeats_that_both_have_are_paired() -> None:
    assert measures.paired_log_ratios({0: 4.0, 1: 4.0}, {1: 2.0, 2: 1.0}) == pytest.approx([math.log(2)])
    assert measures.paired_log_ratios({0: 4.0}, {1: 2.0}).size == 0


@given(TIMES, TIMES)
def test_swapping_default_and_best_inverts_the_speedup(default: list[int], best: list[int]) -> None:
    runs = {0: mean_time(default)}, {0: mean_time(best)}

    there, back = measures.paired_log_ratios(*runs), measures.paired_log_ratios(*reversed(runs))

    assert there.mean() == pytest.approx(-back.mean())


def test_drift_is_the_median_of_like_frames() -> None:
    first = np.arange(1, 101)
    second = first * 1.2
    second[50:60] *= 50  # a hiccup is not a drift

    assert measures.drifts(first[None, None], second[None, None]) == [pytest.approx(1.2)]
    assert measures.drifts(np.zeros((1, 1, 100)), second[None, None]) == [None]


def test_one_slow_repeat_of_many_is_no_drift() -> None:
    earlier = np.full((1, 5, 100), 1000)
    later = earlier.copy()
    later[:, -1] = 1500

    [drift] = measures.drifts(earlier, later)

    assert drift == pytest.approx(1.1)
    assert not measures.has_drifted(drift)


@pytest.mark.parametrize("first_counted_frame", [0, 10, 100])
def test_drifts_of_many_are_those_of_each(first_counted_frame: int) -> None:
    random = np.random.default_rng(1)
    first, last = (random.integers(1, 90_000, (6, 2, 100)).astype(np.uint32) for _ in range(2))
    first[1, 0, 20:25] = 0  # a clock that stood still
    last[2] = 0

    found = measures.drifts(first, last, first_counted_frame)

    each = [
        measures.drifts(one[None], other[None], first_counted_frame)
        for one, other in zip(first, last, strict=True)
    ]
    assert [[value] for value in found] == each
    assert (found[1] is None) == (first_counted_frame == 100)
    assert found[2] is None


def test_drift_counts_in_both_directions() -> None:
    assert measures.has_drifted(1.2)
    assert measures.has_drifted(1 / 1.2)
    assert not measures.has_drifted(1 / 1.1)
    assert not measures.has_drifted(None)


def test_stages_may_not_take_longer_than_the_frame() -> None:
    def exceed(**stages: int) -> bool:
        frames, series = np.full((1, 100), 1000), [[time] * 100 for time in stages.values()]
        found = measures.stages_exceed_frames(frames, list(stages), np.array(series).reshape(1, -1))
        return bool(found[0])

    assert not exceed(tracking=500, raycasting=500)
    assert not exceed(acquisition=9000, tracking=900)
    assert not exceed()
    assert exceed(tracking=800, raycasting=800)


def test_a_clock_that_falls_is_told_from_one_that_wavers() -> None:
    assert measures.clock_fall([2400.0] * 3 + [1200.0] * 3) == pytest.approx(2.0)
    assert measures.clock_fall([2400.0, 1200.0] * 6) == pytest.approx(1.0)
    assert measures.clock_fall([2400.0, 1200.0]) is None


ABBA = ["default", "best", "best", "default"]
ALL = ["default", "best", "knee", "fast", "fast", "knee", "best", "default"]
HONEST = {
    "as planned": (ABBA, 2),
    "two rounds": (ABBA * 2, 4),
    "interrupted before the last run": ([*ABBA, "default", "best", "best"], 2),
    "the whole front": (ALL, 2),
    "three repeats, forwards, back and forwards": (
        ["default", "best", "best", "default", "default", "best"],
        3,
    ),
    "one repeat": (["default", "best"], 1),
}


@pytest.mark.parametrize(("order", "planned"), HONEST.values(), ids=HONEST)
def test_what_the_client_runs_is_complete_and_balanced(order: list[str], planned: int) -> None:
    for name in set(order) - {"default"}:
        pair = places(order, "default"), places(order, name)
        assert measures.complete_pairs(*pair, planned)
        assert measures.balanced_order(*pair)


def test_half_a_session_is_not_complete() -> None:
    assert not measures.complete_pairs({0: 0}, {0: 1}, 2)
    assert not measures.complete_pairs({0: 0, 1: 3}, {0: 1}, 2)


def test_a_gap_among_the_pairs_is_not_complete() -> None:
    every = places(ABBA * 2, "default"), places(ABBA * 2, "best")

    del every[1][1]

    assert not measures.complete_pairs(*every, 2)


def test_a_configuration_that_always_runs_later_is_not_balanced() -> None:
    one_after_another = ["default", "default", "best", "best"]
    in_turns = ["default", "best", "default", "best"]

    for order in (one_after_another, in_turns):
        assert not measures.balanced_order(places(order, "default"), places(order, "best"))


def test_a_session_has_a_t_interval_over_its_pairs() -> None:
    logs = [2.0, 2.1, 1.9, 2.05]

    low, high = stats.t.interval(0.95, 3, loc=np.mean(logs), scale=stats.sem(logs))
    assert measures.session_interval(logs) == (pytest.approx(low), pytest.approx(high))


def test_two_pairs_have_no_interval() -> None:
    assert measures.session_interval([2.0, 2.1]) is None
