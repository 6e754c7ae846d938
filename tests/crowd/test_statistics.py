"""The statistics against figures that can be worked out by hand, and against simulation."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from crowd.results.figures import statistics
from crowd.results.figures.statistics import InstallationValue

TIMES = st.lists(st.integers(1, 10**6), min_size=100, max_size=100)
TRUTH = math.log(5.0)


def installations(*sessions: list[float]) -> list[InstallationValue]:
    """Installations with the log ratios of their sessions, a list for each."""
    return [
        InstallationValue(
            float(np.mean(logs)), float(np.std(logs, ddof=1)) if len(logs) > 1 else 0.0, len(logs)
        )
        for logs in sessions
    ]


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
    figure = statistics.model_speedup(installations([1.0] * 50, [2.0] * 50))

    assert (figure.speedup.low, figure.speedup.high) == (None, None)
    assert figure.speedup.value == pytest.approx(math.exp(1.5))


def test_the_interval_is_students_t_over_installations() -> None:
    means = [1.9, 2.0, 2.2, 2.1]

    figure = statistics.model_speedup(installations(*([mean - 0.1, mean + 0.1] for mean in means)))

    low, high = stats.t.interval(0.95, len(means) - 1, loc=np.mean(means), scale=stats.sem(means))
    assert figure.speedup.low == pytest.approx(math.exp(low))
    assert figure.speedup.high == pytest.approx(math.exp(high))
    assert (figure.sessions, figure.installations, figure.repeat) == (8, 4, None)


def test_one_installation_gets_a_repeatability_and_no_interval() -> None:
    logs = [2.0, 2.1, 1.9]

    figure = statistics.model_speedup(installations(logs))

    low, high = stats.t.interval(0.95, 2, loc=2.0, scale=stats.sem(logs))
    assert figure.speedup == statistics.Interval(pytest.approx(math.exp(2.0)), None, None)
    assert figure.repeat is not None
    assert figure.repeat.low == pytest.approx(math.exp(low))
    assert figure.repeat.high == pytest.approx(math.exp(high))


def test_an_eager_installation_weighs_as_much_as_any_other() -> None:
    figure = statistics.model_speedup(installations([1.0], [1.0], [3.0] * 400))

    assert figure.speedup.value == pytest.approx(math.exp(5 / 3))


def test_at_most_five_sessions_of_an_installation_and_day_count() -> None:
    keys = [("ada", 1)] * 7 + [("ada", 2)] * 2 + [("bob", 1)]

    assert statistics.within_daily_limit(keys) == [True] * 5 + [False] * 2 + [True] * 3


def test_the_crowds_figure_is_the_geometric_mean_over_models() -> None:
    assert statistics.crowd_speedup([2.0, 8.0]) == statistics.Interval(pytest.approx(4.0), None, None)
    assert statistics.crowd_speedup([]) is None


def test_the_crowds_interval_is_students_t_over_models() -> None:
    speedups = [2.0, 4.0, 5.0, 9.0]

    crowd = statistics.crowd_speedup(speedups)

    logs = np.log(speedups)
    low, high = stats.t.interval(0.95, 3, loc=logs.mean(), scale=stats.sem(logs))
    assert crowd is not None
    assert (crowd.low, crowd.high) == (pytest.approx(math.exp(low)), pytest.approx(math.exp(high)))


def test_a_clock_that_falls_is_told_from_one_that_wavers() -> None:
    assert statistics.clock_fall([2400.0] * 3 + [1200.0] * 3) == pytest.approx(2.0)
    assert statistics.clock_fall([2400.0, 1200.0] * 6) == pytest.approx(1.0)
    assert statistics.clock_fall([2400.0, 1200.0]) is None


def test_the_usual_range_does_not_follow_an_outlier() -> None:
    """Of 2.0, 2.1, 1.9 and 9.0 mean and standard deviation would let 9.0 pass: z = 1.5."""
    usual = statistics.usual_range([2.0, 2.1, 1.9, 9.0])

    assert usual is not None
    assert usual[0] < 1.9
    assert usual[1] < 9.0
    assert statistics.usual_range([2.0, 9.0]) is None


def test_installations_that_agree_to_the_last_digit_leave_room_for_a_tenth() -> None:
    usual = statistics.usual_range([2.0] * 20)

    assert usual == (pytest.approx(2 - 5 * math.log(1.1)), pytest.approx(2 + 5 * math.log(1.1)))


@given(st.lists(st.tuples(st.integers(0, 4), st.floats(-1, 1)), max_size=30))
def test_agreement_takes_another_installation(sessions: list[tuple[int, float]]) -> None:
    expected = [
        not any(other != who and abs(their - mine) <= statistics.AGREEMENT for other, their in sessions)
        for who, mine in sessions
    ]

    assert statistics.without_agreement(sessions) == expected


@given(TIMES, TIMES)
def test_swapping_default_and_best_inverts_the_speedup(default: list[int], best: list[int]) -> None:
    runs = {0: statistics.run_value(default)}, {0: statistics.run_value(best)}

    there, back = statistics.paired_log_ratios(*runs), statistics.paired_log_ratios(*reversed(runs))

    assert there.mean() == pytest.approx(-back.mean())


def covered(logs: list[InstallationValue]) -> bool:
    interval = statistics.model_speedup(logs).speedup
    assert interval.low is not None
    assert interval.high is not None
    return interval.low <= 5.0 <= interval.high


@pytest.mark.parametrize(("people", "each"), [(3, 1), (3, 20), (5, 5), (20, 3)])
@pytest.mark.parametrize(("between", "within"), [(0.05, 0.03), (0.15, 0.03), (0.02, 0.10)])
def test_the_interval_covers_the_truth_as_often_as_it_says(
    people: int, each: int, between: float, within: float
) -> None:
    """Installations differ, and so do the sessions of each. Pooling 5 by 5 sessions would cover 62 %."""
    random = np.random.default_rng(7)
    centres = random.normal(TRUTH, between, (2000, people, 1))
    logs = random.normal(centres, within, (2000, people, each))

    hits = [
        covered([InstallationValue(value, 0.0, each) for value in means])
        for means in logs.mean(axis=2).tolist()
    ]

    assert 0.93 <= np.mean(hits) <= 0.98


def test_one_eager_installation_does_not_spoil_the_interval() -> None:
    """One sends 400 sessions, four send two each: an interval over all sessions would cover a fifth."""
    random = np.random.default_rng(8)
    counts = np.array([400, 2, 2, 2, 2])
    hits = []
    for _ in range(2000):
        means = random.normal(TRUTH, 0.05, 5) + random.normal(0, 0.03, 5) / np.sqrt(counts)
        hits.append(covered([InstallationValue(mean, 0.0, 1) for mean in means.tolist()]))

    assert 0.93 <= np.mean(hits) <= 0.98


def test_hiding_outliers_leaves_the_interval_honest() -> None:
    """Noise alone is hardly ever hidden, and of what is not, the interval covers the truth as before."""
    random = np.random.default_rng(9)
    hits, hidden = [], 0
    for means in random.normal(TRUTH, 0.08, (2000, 6)).tolist():
        usual = statistics.usual_range(means)
        assert usual is not None
        alone = statistics.without_agreement(list(enumerate(means)))
        kept = [
            mean
            for mean, lonely in zip(means, alone, strict=True)
            if not lonely or usual[0] <= mean <= usual[1]
        ]
        hidden += len(means) - len(kept)
        hits.append(covered([InstallationValue(mean, 0.0, 1) for mean in kept]))

    assert hidden < 12  # of 12,000
    assert 0.93 <= np.mean(hits) <= 0.98


def test_a_fake_ten_times_as_fast_moves_nothing() -> None:
    honest = [TRUTH - 0.05, TRUTH, TRUTH + 0.05]
    fake = TRUTH + math.log(10)

    usual = statistics.usual_range([*honest, fake])

    assert usual is not None
    assert all(usual[0] <= value <= usual[1] for value in honest)
    assert fake > usual[1]
