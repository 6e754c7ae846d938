"""Correlation of devices: the coefficients, and whether their intervals hold what they promise."""

import math

import numpy as np
import pytest
from scipy import stats

from pareto.devices.correlation import MINIMUM, correlate, correlation_matrix, ranks_of_best
from pareto.errors import ObjectiveError


def devices(count, rho, rng):
    """Times of `count` configurations on two devices whose logarithms are jointly normal."""
    first, other = rng.standard_normal((2, count))
    return np.exp(first), np.exp(0.5 * (rho * first + math.sqrt(1 - rho**2) * other) - 2.0)


def test_coefficients_are_scipys():
    first, second = devices(50, 0.7, np.random.default_rng(1))
    second[3] = second[9]  # a tie
    correlation = correlate(first, second)
    assert correlation.count == 50
    assert correlation.pearson.value == pytest.approx(stats.pearsonr(first, second).statistic)
    assert correlation.spearman.value == pytest.approx(stats.spearmanr(first, second).statistic)
    of_logarithms = correlate(first, second, log=True)
    assert of_logarithms.pearson.value == pytest.approx(
        stats.pearsonr(np.log(first), np.log(second)).statistic
    )
    assert of_logarithms.spearman == correlation.spearman


def test_fishers_interval_is_scipys():
    first, second = devices(30, 0.6, np.random.default_rng(2))
    expected = stats.pearsonr(first, second).confidence_interval(0.9)
    pearson = correlate(first, second, level=0.9).pearson
    assert (pearson.low, pearson.high) == pytest.approx((expected.low, expected.high), abs=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(("count", "rho"), [(MINIMUM, 0.0), (8, 0.8), (20, 0.5), (40, -0.9)])
def test_intervals_cover_the_truth_as_often_as_they_say(count, rho):
    rng = np.random.default_rng(count)
    runs = 800
    truth = 6 / math.pi * math.asin(rho / 2)  # Spearman of a normal pair: Pearson 1907
    correlations = [correlate(*devices(count, rho, rng), log=True) for _ in range(runs)]
    pearson = sum(item.pearson.low <= rho <= item.pearson.high for item in correlations) / runs
    spearman = sum(item.spearman.low <= truth <= item.spearman.high for item in correlations) / runs
    # Four standard errors of a share of .95 are .03; Bonett and Wright's is wide on very few pairs.
    assert 0.92 <= pearson <= 0.98
    assert 0.92 <= spearman <= (1.0 if count < 10 else 0.98)


def test_a_sample_in_perfect_order_is_no_proof_of_perfect_order():
    correlation = correlate(range(6), [1, 2, 4, 8, 16, 32])
    assert correlation.spearman.value == pytest.approx(1.0)
    assert correlation.spearman.low < 0.8
    assert correlation.spearman.high == pytest.approx(1.0)
    upside_down = correlate(range(6), [-1, -2, -4, -8, -16, -32])
    assert upside_down.spearman.low == pytest.approx(-1.0)
    assert upside_down.spearman.high == pytest.approx(-correlation.spearman.low)


@pytest.mark.parametrize("slope", [3.0, -0.1])
def test_a_sample_on_a_line_is_no_proof_of_a_line(slope):
    few, many = (correlate(np.arange(n), slope * np.arange(n) + 7.0).pearson for n in (6, 60))
    assert few.value == pytest.approx(math.copysign(1.0, slope))
    assert min(abs(few.low), abs(few.high)) < 0.9
    assert max(abs(few.low), abs(few.high)) == pytest.approx(1.0)
    assert 0.999 < min(abs(many.low), abs(many.high)) < 1.0


def test_a_tighter_level_gives_a_narrower_interval_around_the_same_value():
    first, second = devices(30, 0.6, np.random.default_rng(3))
    wide, narrow = correlate(first, second, level=0.99), correlate(first, second, level=0.5)
    for a, b in [(wide.pearson, narrow.pearson), (wide.spearman, narrow.spearman)]:
        assert a.low < b.low < a.value == b.value < b.high < a.high


def test_too_few_common_configurations_or_one_value_everywhere_say_nothing():
    assert correlate([1, 2, 3, 4, np.nan, 6], [1, 2, 3, np.nan, 5, 7]) is None
    assert correlate([1] * 9, range(9)) is None
    assert correlate([], []) is None
    nearly_equal = [1e300, *[math.nextafter(1e300, math.inf)] * 8]
    assert correlate(nearly_equal, range(1, 10)).count == 9
    assert correlate(nearly_equal, range(1, 10), log=True) is None
    assert correlate([1, 2, 3, 4, 5, np.nan], [2, 1, 3, 4, 5, 9]).count == 5
    assert correlate(range(9), range(9), minimum=10) is None


def test_tiny_and_huge_values_are_no_trouble():
    first, second = devices(20, 0.6, np.random.default_rng(4))
    usual, odd = correlate(first, second), correlate(first * 1e-200, second * 1e200)
    assert odd.pearson.value == pytest.approx(usual.pearson.value)


def test_bad_input_is_named():
    for arguments, message in [
        (([1, 2], [1, 2, 3]), "are not pairs"),
        (([[1, 2]], [[1, 2]]), "are not pairs"),
        (([1, math.inf], [1, 2]), "infinite"),
    ]:
        with pytest.raises(ObjectiveError, match=message):
            correlate(*arguments)
    with pytest.raises(ObjectiveError, match="logarithm"):
        correlate(range(9), range(9), log=True)
    with pytest.raises(ObjectiveError, match="level"):
        correlate(range(9), range(9), level=95)
    with pytest.raises(ObjectiveError, match="devices, configurations"):
        correlation_matrix([1, 2, 3])
    with pytest.raises(ObjectiveError, match="no rank"):
        ranks_of_best([[1, 2, -math.inf], [1, 2, 3]])


def test_a_matrix_is_symmetric_and_honest_about_gaps():
    table = np.random.default_rng(5).random((4, 12))
    table[3, :9] = np.nan  # three common configurations with anyone
    matrix = correlation_matrix(table)
    assert matrix[0][1] == matrix[1][0] == correlate(table[1], table[0])
    assert [matrix[i][i] for i in range(4)] == [None] * 4
    assert matrix[3] == [None] * 4


def test_the_rank_of_one_devices_best_on_another():
    table = [[1, 2, 3, 4, np.nan], [9, 5, 7, 6, 1], [np.nan] * 4 + [3.0]]
    ranks = ranks_of_best(table)
    assert ranks[0].tolist()[:2] == [1, 4]  # the fifth configuration ran on the second device only
    assert ranks[1].tolist()[:2] == [2, 1]
    assert np.isnan(ranks[0, 2])
    assert ranks[1, 2] == ranks[2, 1] == 1
    upwards = ranks_of_best(table, maximise=True)
    assert (upwards[0, 1], upwards[1, 0]) == (3, 4)
