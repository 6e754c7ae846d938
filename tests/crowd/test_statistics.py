"""The statistics against figures that can be worked out by hand, and against simulation."""

import math
from datetime import date

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from crowd.results import statistics
from crowd.results.statistics import SessionValue

DAY = date(2026, 11, 20)
TIMES = st.lists(st.integers(1, 10**6), min_size=100, max_size=100)


def sessions(*installations: list[float], day: date = DAY) -> list[SessionValue]:
    """Sessions with these log ratios, a list for each installation."""
    return [SessionValue(who, day, log) for who, logs in enumerate(installations) for log in logs]


def test_the_first_ten_frames_do_not_count() -> None:
    assert statistics.run_value([10**6] * 10 + [3] * 90) == 3


def test_periodic_work_counts_in_full() -> None:
    """A median would say 1 of a configuration that works 100 every tenth frame."""
    assert statistics.run_value(([1] * 9 + [100]) * 10) == pytest.approx(10.9)


def test_a_run_without_counted_frames_has_no_value() -> None:
    with pytest.raises(ValueError, match="from frame 10 on"):
        statistics.run_value([1] * 10)


def test_a_steady_drift_cancels_in_the_order_default_best_best_default() -> None:
    warm = [1.0, 1.1, 1.21, 1.331]  # each run 10 % slower than the one before

    ratios = statistics.paired_log_ratios(
        {0: 80 * warm[0], 1: 80 * warm[3]}, {0: 10 * warm[1], 1: 10 * warm[2]}
    )

    assert math.exp(ratios.mean()) == pytest.approx(8.0)


def test_only_repeats_that_both_have_are_paired() -> None:
    assert statistics.paired_log_ratios({0: 4.0, 1: 4.0}, {1: 2.0, 2: 1.0}) == pytest.approx([math.log(2)])
    assert statistics.paired_log_ratios({0: 4.0}, {1: 2.0}).size == 0


def test_drift_is_the_median_of_like_frames() -> None:
    first = np.arange(1, 101)
    second = first * 1.2
    second[50:60] *= 50  # a hiccup is no drift

    assert statistics.drift(first, second) == pytest.approx(1.2)
    assert statistics.drift([0] * 100, second) is None


def test_stages_may_not_take_longer_than_the_frame() -> None:
    frame = [1000] * 100

    assert not statistics.stages_exceed_frames(frame, {"tracking": [500] * 100, "raycasting": [500] * 100})
    assert not statistics.stages_exceed_frames(frame, {"acquisition": [9000] * 100, "tracking": [900] * 100})
    assert not statistics.stages_exceed_frames(frame, {})
    assert statistics.stages_exceed_frames(frame, {"tracking": [800] * 100, "raycasting": [800] * 100})


def test_no_interval_below_three_installations() -> None:
    figure = statistics.model_speedup(sessions([1.0] * 50, [2.0] * 50))

    assert (figure.speedup.low, figure.speedup.high) == (None, None)
    assert figure.speedup.value == pytest.approx(math.exp(1.5))


def test_the_interval_is_students_t_over_installations() -> None:
    means = [1.9, 2.0, 2.2, 2.1]

    figure = statistics.model_speedup(sessions(*([mean - 0.1, mean + 0.1] for mean in means)))

    low, high = stats.t.interval(0.95, len(means) - 1, loc=np.mean(means), scale=stats.sem(means))
    assert figure.speedup.low == pytest.approx(math.exp(low))
    assert figure.speedup.high == pytest.approx(math.exp(high))
    assert (figure.sessions, figure.installations, figure.repeat) == (8, 4, None)


def test_one_installation_gets_a_repeatability_and_no_interval() -> None:
    figure = statistics.model_speedup(sessions([2.0, 2.1, 1.9]))

    assert figure.speedup.low is None
    assert figure.repeat is not None
    assert figure.repeat.value == figure.speedup.value
    assert figure.repeat.low is not None


def test_an_eager_installation_weighs_as_much_as_any_other() -> None:
    eager = [SessionValue("eager", date(2026, 1, 1 + n % 28), 3.0) for n in range(400)]

    figure = statistics.model_speedup([*sessions([1.0], [1.0]), *eager])

    assert figure.speedup.value == pytest.approx(math.exp(5 / 3))


def test_at_most_five_sessions_of_an_installation_and_day_count() -> None:
    figure = statistics.model_speedup(sessions([1.0] * 5 + [9.0] * 95))

    assert figure.speedup.value == pytest.approx(math.exp(1.0))
    assert figure.sessions == 5


def test_the_crowds_figure_is_the_geometric_mean_over_models() -> None:
    assert statistics.crowd_speedup([2.0, 8.0]) == pytest.approx(4.0)
    assert statistics.crowd_speedup([]) is None


@given(TIMES, TIMES)
def test_swapping_default_and_best_inverts_the_speedup(default: list[int], best: list[int]) -> None:
    runs = {0: statistics.run_value(default)}, {0: statistics.run_value(best)}

    there, back = statistics.paired_log_ratios(*runs), statistics.paired_log_ratios(*reversed(runs))

    assert there.mean() == pytest.approx(-back.mean())


def test_the_interval_covers_the_truth_as_often_as_it_says() -> None:
    """5 % between installations and 3 % within, 5 by 5: pooling all sessions would cover 62 %."""
    random = np.random.default_rng(7)
    truth, trials, covered = math.log(5.0), 2000, 0
    for _ in range(trials):
        between = random.normal(truth, 0.05, 5)
        logs = [list(random.normal(centre, 0.03, 5)) for centre in between]
        interval = statistics.model_speedup(sessions(*logs)).speedup
        assert interval.low is not None
        assert interval.high is not None
        covered += interval.low <= 5.0 <= interval.high
    assert 0.93 <= covered / trials <= 0.98
