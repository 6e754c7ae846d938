"""Predicting a whole grid at once gives what scikit-learn gives row by row."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pareto.surrogates.forest import Forest, paint

SHAPES = [(7,), (4, 3), (3, 1, 5), (2, 2, 2, 2, 2, 2), (4, 5, 6, 3, 20)]


def grid_codes(shape):
    return np.stack(np.unravel_index(np.arange(np.prod(shape)), shape), axis=-1)


def some_targets(codes, rng):
    weights = rng.normal(size=codes.shape[1])
    return np.exp(np.sin(codes @ weights) * 3 + rng.normal(size=len(codes)) * 0.3) * 1e3


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("extra", [True, False])
def test_the_whole_grid_is_predicted_like_scikit_learn(shape, extra):
    rng = np.random.default_rng(3)
    codes = grid_codes(shape)[rng.integers(0, np.prod(shape), 60)]
    forest = Forest.grow(codes, some_targets(codes, rng), shape, seed=1, trees=17, extra=extra)
    everywhere = grid_codes(shape)
    theirs = forest.predict(everywhere)
    np.testing.assert_allclose(forest.predict_grid(), theirs, rtol=1e-9)
    mean, spread = forest.predict_grid_with_spread()
    by_tree = np.array([tree.predict(everywhere.astype(np.float32)) for tree in forest.estimator.estimators_])
    np.testing.assert_allclose(mean, theirs, rtol=1e-9)
    rounding = 1e-14 * np.abs(by_tree).max() ** 2
    np.testing.assert_allclose(spread**2, by_tree.var(axis=0), rtol=1e-9, atol=rounding)
    mean, spread = forest.predict_with_spread(everywhere)
    np.testing.assert_allclose(mean, theirs, rtol=1e-9)
    np.testing.assert_allclose(spread, by_tree.std(axis=0), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("size", [1e-30, 1e30])
def test_one_tree_and_targets_of_any_size(size):
    rng = np.random.default_rng(5)
    codes = grid_codes((5, 4))
    targets = size * rng.normal(size=20)
    forest = Forest.grow(codes, targets, (5, 4), seed=0, trees=1)
    mean, spread = forest.predict_grid_with_spread()
    np.testing.assert_allclose(mean, forest.predict(codes), rtol=1e-9)
    np.testing.assert_allclose(spread, 0.0, atol=1e-7 * size)


def test_points_in_the_same_leaves_are_predicted_exactly_alike():
    rng = np.random.default_rng(0)
    shape = (6, 6, 6)
    codes = grid_codes(shape)[rng.integers(0, 216, 12)]
    forest = Forest.grow(codes, some_targets(codes, rng), shape, seed=0, trees=100)
    leaves = forest.estimator.apply(grid_codes(shape).astype(np.float32))
    _, group = np.unique(leaves, axis=0, return_inverse=True)
    predicted = forest.predict_grid()
    assert len(np.unique(predicted)) <= group.max() + 1
    for value in range(group.max() + 1):
        assert np.ptp(predicted[group.ravel() == value]) == 0.0


def test_a_constant_target_is_predicted_as_itself():
    codes = grid_codes((3, 4))
    forest = Forest.grow(codes, np.full(12, 0.1), (3, 4), seed=0, trees=3)
    mean, spread = forest.predict_grid_with_spread()
    np.testing.assert_allclose(mean, 0.1, rtol=1e-12)
    np.testing.assert_array_equal(spread, 0.0)


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_painted_boxes_are_the_boxes_painted_one_by_one(seed):
    rng = np.random.default_rng(seed)
    shape = tuple(rng.integers(1, 6, size=rng.integers(1, 5)).tolist())
    low = np.stack([rng.integers(0, size, 8) for size in shape], axis=1)
    high = np.stack([rng.integers(low[:, axis] + 1, size + 1) for axis, size in enumerate(shape)], axis=1)
    values = rng.integers(-(2**40), 2**40, (2, 8))
    grid = np.zeros((2, *shape), dtype=np.int64)
    for layer, value in zip(grid, values, strict=True):
        for box in range(8):
            layer[tuple(slice(a, b) for a, b in zip(low[box], high[box], strict=True))] += value[box]
    np.testing.assert_array_equal(paint(low, high, values, shape), grid.reshape(2, -1))
