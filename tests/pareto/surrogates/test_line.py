"""The line between two devices: right where it is sure, silent where chance explains it as well."""

import numpy as np
import pytest

from pareto.surrogates.line import LEAST, SURE, fitted_line

X = np.linspace(-3.0, 3.0, 20)


def noisy(slope, noise, seed, count=20):
    """Points of a line through (0, 7)."""
    rng = np.random.default_rng(seed)
    x = rng.standard_normal(count)
    return x, 7.0 + slope * x + noise * rng.standard_normal(count)


def test_an_exact_line_is_found_exactly():
    for slope in (2.0, -0.5):
        line = fitted_line(X, 7.0 + slope * X)
        assert line.slope == pytest.approx(slope)
        assert line.offset == pytest.approx(7.0)


def test_slope_and_t_are_those_of_least_squares():
    from scipy import stats

    x, y = noisy(0.8, 0.5, seed=4)  # whose points are all within the fences
    expected = stats.linregress(x, y)
    t = expected.slope / expected.stderr
    line = fitted_line(x, y)
    assert line.t == pytest.approx(t)
    assert line.slope == pytest.approx(expected.slope * (1 - (SURE / t) ** 2))
    assert line.offset == pytest.approx(y.mean() - line.slope * x.mean())


def test_points_that_have_nothing_to_do_with_each_other_have_no_slope():
    for count, most in ((8, 0.06), (20, 0.04), (200, 0.03)):
        slopes = [fitted_line(*noisy(0.0, 1.0, seed, count)).slope for seed in range(500)]
        assert np.mean(np.array(slopes) != 0) < most


def test_points_that_do_keep_most_of_theirs():
    for slope in (1.0, -1.0):
        slopes = [fitted_line(*noisy(slope, 0.3, seed)).slope for seed in range(100)]
        assert 0.85 < np.median(slopes) / slope < 1.0
        assert min(np.array(slopes) / slope) > 0.5


def test_one_wild_value_does_not_turn_the_line():
    y = 7.0 + X + 0.1 * np.random.default_rng(3).standard_normal(len(X))
    for index, least in ((0, 0.0), (7, 0.3), (12, 0.3)):  # at an end it may silence the line
        wild = y.copy()
        wild[index] = 1e6
        assert least <= fitted_line(X, wild).slope < 1.5
        odd = X.copy()
        odd[index] = -1e6
        assert least <= fitted_line(odd, y).slope < 1.5


def test_too_few_points_or_one_place_say_nothing_but_their_mean():
    few = np.arange(LEAST - 1.0)
    assert fitted_line(few, 2 * few) == (0.0, pytest.approx(2 * few.mean()), 0.0)
    assert fitted_line(np.full(9, 0.1), np.arange(9.0)) == (0.0, 4.0, 0.0)
    assert fitted_line(np.arange(9.0), np.full(9, 5.0)) == (0.0, 5.0, 0.0)
    assert fitted_line(np.array([2.0]), np.array([3.0])) == (0.0, 3.0, 0.0)


def test_units_do_not_matter():
    x, y = noisy(1.0, 0.3, seed=5)
    usual = fitted_line(x, y)
    for unit in (1e-200, 1e200):
        assert fitted_line(x * unit, y).slope == pytest.approx(usual.slope / unit)
        assert fitted_line(x, y * unit).slope == pytest.approx(usual.slope * unit)
