"""The noise of a measurement, from repeats alone."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pareto import Space
from pareto.fronts.objective import Objective
from pareto.search.history import History
from pareto.search.noise import Noise
from pareto.search.targets import Targets

SPACE = Space.from_dict({"parameters": [{"name": "x", "type": "integer", "minimum": 0, "maximum": 99}]})


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
    noise = noise_of({1: [(1.0, 5.0), (2.0, 5.0), (4.0, 5.0)], 2: [(3.0, 5.0), (9.0, 5.0)], 3: [(7.0, 6.0)]})
    squares = np.var(np.log([1, 2, 4])) * 3 + np.var(np.log([3, 9])) * 2
    np.testing.assert_allclose(noise.variance, [squares / 3, 0.0], rtol=1e-12)
    assert noise.freedom == 3
    assert noise.known
    assert noise


def test_values_that_are_not_positive_count_in_shares_of_the_largest():
    noise = noise_of({1: [(-4.0, 1.0), (-8.0, 1.0)], 2: [(2.0, 1.0)]})
    np.testing.assert_allclose(noise.variance, [np.var([-0.5, -1.0]) * 2, 0.0], rtol=1e-12)


@pytest.mark.parametrize("pair", [(-1.0, 3.0), (0.0, 3.0)])
def test_one_measurement_that_is_not_positive_takes_the_logarithm_from_all(pair):
    history = history_of({1: [(1.0,)], 2: [(value,) for value in pair]}, ("a",))
    targets = Targets.of(history)
    assert not targets.scale.log[0]
    np.testing.assert_allclose(Noise.of(history, targets).variance, [np.var(pair) * 2 / 9], rtol=1e-12)


def test_without_repeats_nothing_is_known():
    noise = noise_of({1: [(1.0, 5.0)], 2: [(2.0, 5.0)]})
    assert not noise.known
    assert not noise
    assert noise.expected(0, 0.25) == 0.25  # then all that a model cannot follow may be noise


def test_failed_repeats_do_not_count():
    noise = noise_of({1: [(1.0, 5.0), None, None], 2: [None, None], 3: [(2.0, 5.0)]})
    assert not noise.known
    assert noise_of({1: [(1.0, 1.0), None, (2.0, 1.0)]}).freedom == 1


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
    assert noise.variance[0] == 0.0
    assert noise.expected(0, nugget=1.0) == 0.0
    assert noise.freedom == len(values) * (count - 1)
    assert history_of(repeated).measured()[1][:, 0].tolist() == values


def test_few_repeats_are_tempered_by_what_a_model_cannot_follow():
    noise = Noise(np.array([0.09, 0.0]), 3)
    assert noise.expected(0, nugget=0.01) == pytest.approx((3 * 0.09 + 0.01) / 4)
    assert noise.expected(1, nugget=0.01) == 0.0


def test_the_mean_of_measurements_does_not_overflow():
    history = history_of({1: [(1.7e308,), (1.6e308,)], 2: [(1.0,)]}, ("a",))
    np.testing.assert_allclose(history.measured()[1], [[1.65e308], [1.0]])
