"""Which speedups are plausible before others confirm them."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from crowd.results.validity import measures, plausibility


def test_where_nothing_is_known_the_bounds_are_wide() -> None:
    assert plausibility.plausible_range(None, []) == (math.log(1 / 4), math.log(64))


def test_a_prediction_bounds_the_speedup() -> None:
    low, high = plausibility.plausible_range(8.0, [])

    assert (math.exp(low), math.exp(high)) == (pytest.approx(0.25), pytest.approx(32.0))


def test_a_configuration_that_is_predicted_to_be_slower_may_be_slower() -> None:
    low, high = plausibility.plausible_range(0.4, [])

    assert (math.exp(low), math.exp(high)) == (pytest.approx(0.1), pytest.approx(4.0))


def test_what_other_models_reached_is_plausible() -> None:
    low, high = plausibility.plausible_range(8.0, [math.log(0.7), math.log(12.0)])

    assert (math.exp(low), math.exp(high)) == (pytest.approx(0.175), pytest.approx(48.0))


def test_a_prediction_without_a_runtime_is_refused() -> None:
    with pytest.raises(ValueError, match="0"):
        plausibility.plausible_range(0.0, [])


@given(st.lists(st.tuples(st.none() | st.integers(0, 4), st.floats(-1, 1)), max_size=30))
def test_corroboration_takes_a_session_from_another_known_network(
    sessions: list[tuple[int | None, float]],
) -> None:
    expected = [
        any(
            other is not None and other != who and abs(their - mine) <= measures.AGREEMENT
            for other, their in sessions
        )
        for who, mine in sessions
    ]

    assert plausibility.corroborated(sessions) == expected
