"""The noise of a measurement, from repeats alone."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pareto.fronts.objective import Objective
from pareto.search.history import History
from pareto.search.noise import SHARED, Noise, describe_noise
from pareto.search.targets import Targets
from tests.builders.spaces import space_of

SPACE = space_of(x=range(100))


def history_of(measured, names=("a", "b")):
    """A history of {index: [values or None]}."""
    history = History(SPACE, tuple(Objective(name) for name in names), {})
    for index, values in measured.items():
        for row in values:
            history.record(index, row)
    return history


def noise_of(measured, names=("a", "b")):
    history = history_of(measured, names)
    return Noise.of(history, Targets.of(history))


def test_the_variance_of_repeats_is_pooled_over_configurations_and_of_logarithms():
    noise = noise_of(
        {1: [(1.0, 5.0), (2.0, 5.0), (4.0, 5.0)], 2: [(1.0, 5.0), (4.0, 5.0)], 3: [(900.0, 6.0)]}
    )
    squares = np.var(np.log([1, 2, 4])) * 3 + np.var(np.log([1, 4])) * 2
    np.testing.assert_allclose(noise.variance[:2], [[squares / 3, 0.0]] * 2, rtol=0.01)
    np.testing.assert_allclose(noise.freedom[:2, 0], 3.0)
    assert noise.repeats == 3
    assert noise


def test_noise_is_that_of_repeats_of_similar_values_first():
    """Where times are short, noise is often larger; far from all repeats, all count the same."""
    short = {index: [(1.0, 1.0), (1.2, 1.2)] for index in range(3)}
    long = {index: [(1000.0, 1.0), (1010.0, 1.2)] for index in range(3, 6)}
    noise = noise_of(short | long | {6: [(1e9, 1.0)]})
    small, large = np.log(1.2) ** 2 / 2, np.log(1.01) ** 2 / 2
    variance, freedom = noise.variance[:, 0], noise.freedom[:, 0]
    assert large < variance[3] < 0.5 * variance[0] < 0.5 * small
    assert variance[6] == pytest.approx((small + large) / 2, rel=0.01)
    assert freedom[6] == pytest.approx(SHARED, rel=0.01)
    assert freedom[6] < freedom[0] < 6
    np.testing.assert_allclose(noise.variance[:, 1], small, rtol=1e-9)  # values alike: one noise
    assert (noise.half_width()[6] > noise.half_width()[0]).all()


def test_values_that_are_not_positive_count_in_shares_of_the_largest():
    noise = noise_of({1: [(-4.0, 1.0), (-8.0, 1.0)], 2: [(2.0, 1.0)]})
    np.testing.assert_allclose(noise.variance[0], [np.var([-0.5, -1.0]) * 2, 0.0], rtol=1e-12)


@pytest.mark.parametrize("pair", [(-1.0, 3.0), (0.0, 3.0)])
def test_one_measurement_that_is_not_positive_takes_the_logarithm_from_all(pair):
    history = history_of({1: [(1.0,)], 2: [(value,) for value in pair]}, ("a",))
    targets = Targets.of(history)
    assert not targets.scale.log[0]
    np.testing.assert_allclose(Noise.of(history, targets).variance[0], [np.var(pair) * 2 / 9], rtol=1e-12)


def test_without_repeats_nothing_is_known():
    history = history_of({1: [(1.0, 5.0)], 2: [(2.0, 5.0)]})
    noise = Noise.of(history, Targets.of(history))
    assert noise.repeats == 0
    assert not noise
    assert "unknown" in describe_noise(history)


def test_noise_is_described_in_percent_of_times_and_as_none_where_all_agree():
    history = history_of({1: [(1.0, 5.0), (1.1, 5.0)], 2: [(2.0, 6.0)]})
    assert describe_noise(history) == "noise of a measurement, from one repeat: a 6.7 %, b none"


def test_rounds_of_another_program_tell_the_noise_and_measure_nothing():
    history = history_of({1: [(1.0, 5.0)], 2: [(2.0, 6.0)]})
    history.rounds = [(1.0, 5.0), (1.1, 5.0), (0.95, 5.0)]
    noise = Noise.of(history, Targets.of(history))
    assert noise.repeats == 2
    np.testing.assert_allclose(noise.variance[0], [np.var(np.log([1.0, 1.1, 0.95])) * 1.5, 0.0])
    assert history.counts().tolist() == [1, 1]


def test_failed_repeats_do_not_count():
    assert noise_of({1: [(1.0, 5.0), None, None], 2: [None, None], 3: [(2.0, 5.0)]}).repeats == 0
    assert noise_of({1: [(1.0, 1.0), None, (2.0, 1.0)]}).repeats == 1


@settings(max_examples=50, deadline=None)
@given(
    st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=4),
    st.integers(2, 7),
    st.lists(st.floats(1e-3, 1e3), min_size=7, max_size=7),
)
def test_equal_measurements_have_no_noise_to_the_last_digit(values, count, others):
    """Also where those of another objective differ, and they count as that one value."""
    repeated = {index: [(value, others[k]) for k in range(count)] for index, value in enumerate(values)}
    noise = noise_of(repeated)
    assert not noise.variance[:, 0].any()
    assert not noise.expected(0, nugget=1.0).any()
    assert noise.repeats == len(values) * (count - 1)
    assert history_of(repeated).measured()[1][:, 0].tolist() == values


def test_few_repeats_are_tempered_by_what_a_model_cannot_follow():
    noise = Noise(np.array([[0.09, 0.0]]), np.array([[3.0, 3.0]]), 3)
    assert noise.expected(0, nugget=0.01) == pytest.approx([(3 * 0.09 + 0.01) / 4])
    assert noise.expected(1, nugget=0.01) == [0.0]


def test_the_mean_of_measurements_does_not_overflow():
    history = history_of({1: [(1.7e308,), (1.6e308,)], 2: [(1.0,)]}, ("a",))
    np.testing.assert_allclose(history.measured()[1], [[1.65e308], [1.0]])
