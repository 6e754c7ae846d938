"""Which speedups are plausible before others confirm them."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from crowd.results.validity import measures, plausibility


@pytest.mark.parametrize(
    ("predicted", "reached", "low", "high"),
    [
        (None, [], 1 / 4, 64.0),
        (8.0, [], 0.25, 32.0),
        (0.4, [], 0.1, 4.0),  # predicted to be slower
        (8.0, [0.7, 12.0], 0.175, 48.0),  # what other models reached is plausible
    ],
)
def test_a_prediction_and_other_models_bound_a_speedup(
    predicted: float | None, reached: list[float], low: float, high: float
) -> None:
    bounds = plausibility.plausible_range(predicted, [math.log(speedup) for speedup in reached])

    assert tuple(map(math.exp, bounds)) == (pytest.approx(low), pytest.approx(high))


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
