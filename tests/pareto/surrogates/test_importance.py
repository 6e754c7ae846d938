"""Which parameter matters, and how well measurements are predicted: against functions with known answers."""

import numpy as np
import pytest

from pareto.errors import ObjectiveError
from pareto.surrogates.bagging import LEAST_ROWS, MOST_ROWS
from pareto.surrogates.importance import importance
from pareto.surrogates.prediction import predictions
from tests.builders.spaces import space_of

SPACE = space_of(a=range(10), b=range(10), kind=list("pqrst"), c=range(10))
KIND = np.array([0.0, 8.0, 1.0, 7.0, 3.0])


def drawn(count=1000, seed=0):
    indices = np.random.default_rng(seed).choice(len(SPACE), count, replace=False)
    return indices, SPACE.codes(indices).astype(float)


def test_shares_of_a_sum_are_the_shares_of_its_variance():
    indices, codes = drawn()
    values = 3 * codes[:, 0] + codes[:, 1] + KIND[codes[:, 2].astype(int)] - 40
    variances = np.array([9 * codes[:, 0].var(), codes[:, 1].var(), KIND.var(), 0.0])
    shares = importance(SPACE, indices, values)
    assert list(shares) == ["a", "b", "kind", "c"]
    np.testing.assert_allclose(list(shares.values()), variances / variances.sum(), atol=0.05)


def test_an_interaction_counts_for_both_its_parameters():
    indices, codes = drawn()
    shares = importance(SPACE, indices, (codes[:, 0] - 4.5) * (codes[:, 1] - 4.5))
    assert shares["a"] > 0.85
    assert shares["b"] > 0.85
    assert max(shares["c"], shares["kind"]) < 0.02


def test_noise_is_no_parameters_merit():
    indices, _ = drawn()
    assert max(importance(SPACE, indices, np.random.default_rng(1).normal(size=1000)).values()) < 0.06


def test_causes_that_multiply_are_weighed_by_their_logarithms():
    indices, codes = drawn()
    shares = importance(SPACE, indices, np.exp(codes[:, 0]) * np.exp(0.5 * codes[:, 1]))
    np.testing.assert_allclose([shares["a"], shares["b"]], [0.8, 0.2], atol=0.05)


@pytest.mark.slow
def test_failures_are_left_out_and_equal_seeds_agree():
    indices, codes = drawn(400)
    values = codes[:, 0] + 1.0
    gaps = np.where(codes[:, 1] > 7, np.nan, values)
    measured = np.isfinite(gaps)
    assert importance(SPACE, indices, gaps) == importance(SPACE, indices[measured], values[measured])
    assert importance(SPACE, indices, gaps) != importance(SPACE, indices, gaps, seed=1)
    prediction = predictions(SPACE, indices, gaps)
    np.testing.assert_array_equal(prediction.rows, np.flatnonzero(measured))
    np.testing.assert_allclose(prediction.measured, values[measured])


@pytest.mark.parametrize("function", [importance, predictions])
def test_too_little_or_equal_values_have_no_answer(function):
    indices, codes = drawn(40)
    few = np.where(np.arange(40) < LEAST_ROWS - 1, codes[:, 0], np.nan)
    assert function(SPACE, indices, few) is None
    assert function(SPACE, indices, np.full(40, 2.0)) is None
    assert function(SPACE, np.empty(0, dtype=np.int64), []) is None
    with pytest.raises(ObjectiveError, match="one each"):
        function(SPACE, indices, codes)


def test_predictions_of_a_smooth_function_agree_with_its_measurements():
    indices, codes = drawn()
    values = np.exp(0.3 * codes[:, 0] + 0.1 * codes[:, 1])
    prediction = predictions(SPACE, indices, values)
    assert prediction.log
    assert prediction.spearman > 0.99
    assert prediction.r2 > 0.98
    assert np.median(np.abs(prediction.predicted / prediction.measured - 1)) < 0.05


def test_noise_cannot_be_predicted():
    # A forest that had seen these rows would predict them nearly perfectly.
    indices, _ = drawn()
    prediction = predictions(SPACE, indices, np.random.default_rng(1).normal(size=1000))
    assert not prediction.log
    assert abs(prediction.spearman) < 0.15
    assert prediction.r2 < 0.05


def test_of_very_many_measurements_a_part_is_learnt():
    indices, codes = drawn(4900)
    prediction = predictions(SPACE, indices, codes[:, 0])
    assert len(prediction.rows) == MOST_ROWS
    np.testing.assert_array_equal(prediction.measured, codes[prediction.rows, 0])
    assert prediction.r2 > 0.99
