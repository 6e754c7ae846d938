"""The non-dominated filter against its definition, the knee, and choosing from a front."""

import csv
import itertools
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from pareto.errors import ObjectiveError
from pareto.fronts.front import NothingWithinLimitsError, choose, dominates, knee, nondominated


def by_definition(points):
    return np.array([not any(dominates(other, point) for other in points) for point in points], dtype=bool)


few_values = st.sampled_from([-np.inf, -1.0, -0.0, 0.0, 1.0, 2.0, 3.0, np.inf])


@pytest.mark.slow
@settings(max_examples=100, deadline=None)
@given(
    st.integers(1, 5).flatmap(
        lambda m: hnp.arrays(float, st.tuples(st.integers(0, 30), st.just(m)), elements=few_values)
    )
)
def test_the_filter_is_the_definition_with_ties_duplicates_and_infinities(points):
    np.testing.assert_array_equal(nondominated(points), by_definition(points))


@pytest.mark.slow
@settings(max_examples=50, deadline=None)
@given(st.integers(2, 4), st.integers(0, 2**32 - 1))
def test_no_front_row_is_dominated_and_every_other_row_is(objectives, seed):
    points = np.random.default_rng(seed).random((200, objectives)).round(2)
    mask = nondominated(points)
    assert not any(dominates(a, b) for a, b in itertools.permutations(points[mask], 2))
    assert all(any(dominates(a, b) for a in points[mask]) for b in points[~mask])


@settings(max_examples=60)
@given(st.integers(1, 4), st.integers(0, 2**32 - 1), st.lists(few_values, min_size=1))
def test_a_large_table_with_ties_and_infinities_is_decided_like_its_distinct_rows(objectives, seed, values):
    rng = np.random.default_rng(seed)
    points = rng.choice(values, size=(5000, objectives))
    points[rng.random(5000) < 0.1, 0] = np.nan
    distinct, place = np.unique(points[~np.isnan(points[:, 0])], axis=0, return_inverse=True)
    expected = np.zeros(5000, dtype=bool)
    expected[~np.isnan(points[:, 0])] = by_definition(distinct)[place.reshape(-1)]
    np.testing.assert_array_equal(nondominated(points), expected)


@pytest.mark.slow
@pytest.mark.parametrize("objectives", [2, 3, 4])
@pytest.mark.parametrize("shape", ["cloud", "shell", "grid", "skewed", "wide"])
def test_large_tables_agree_with_a_slower_filter(objectives, shape):
    rng = np.random.default_rng(objectives)
    points = rng.random((8_000, objectives))
    if shape == "shell":  # almost every row is on the front
        points = np.abs(rng.normal(size=(5_000, objectives)))
        points = -points / np.linalg.norm(points, axis=1, keepdims=True)
    if shape == "grid":
        points = points.round(1)
    if shape == "skewed":  # a few huge values squeeze all others into one cell of an even grid
        points = np.exp(rng.normal(scale=8, size=points.shape))
        points[:, 0] = 1 / points[:, 1] * (1 + points[:, 0] / points[:, 0].max())
    if shape == "wide":  # the extent itself overflows
        points = (points - 0.5) * 1.7e308 * 2
    moocore = pytest.importorskip("moocore")
    np.testing.assert_array_equal(nondominated(points), moocore.is_nondominated(points, keep_weakly=True))


def test_zeros_of_both_signs_are_equal_in_a_large_table_too():
    points = np.ones((5000, 2))
    points[:, 0] = np.where(np.arange(5000) % 2, 0.0, -0.0)
    assert nondominated(points).all()


def test_rows_with_nan_are_neither_on_the_front_nor_in_its_way():
    points = np.array([[1.0, np.nan], [2.0, 2.0], [np.nan, np.nan], [3.0, 3.0]])
    assert nondominated(points).tolist() == [False, True, False, False]


def test_maximised_columns_are_compared_the_other_way():
    points = np.array([[1.0, 10.0], [2.0, 20.0], [3.0, 15.0]])
    assert nondominated(points, maximise=[False, True]).tolist() == [True, True, False]


def test_an_empty_table_has_an_empty_front():
    assert nondominated(np.empty((0, 2))).shape == (0,)
    assert nondominated([]).shape == (0,)


def test_a_wrong_shape_or_a_wrong_maximise_is_named():
    with pytest.raises(ObjectiveError, match=r"\(3,\)"):
        nondominated([1.0, 2.0, 3.0])
    with pytest.raises(ObjectiveError, match="1 entries for 2"):
        nondominated([[1.0, 2.0]], maximise=[True])


def test_the_knee_is_the_bend_whatever_the_units():
    points = np.array([[0.0, 10.0], [1.0, 2.0], [5.0, 1.5], [10.0, 0.0], [9.0, 9.0]])
    assert knee(points) == 1
    assert knee(points * [1e6, 1e-6]) == 1
    assert knee(points * [1, -1], maximise=[False, True]) == 1


def test_the_knee_needs_a_measured_point():
    with pytest.raises(ObjectiveError, match="missing a value"):
        knee([[np.nan, 1.0]])


FRONT = [
    ("accurate", {"ate": 0.01, "runtime": 0.20, "rate": 5.0}),
    ("middle", {"ate": 0.02, "runtime": 0.10, "rate": 10.0}),
    ("fast", {"ate": 0.06, "runtime": 0.02, "rate": 50.0}),
]


def test_choose_takes_the_fastest_that_is_accurate_enough_and_the_most_accurate_in_time():
    assert choose(FRONT, {"ate": 0.05}, prefer="runtime")[0] == "middle"
    assert choose(FRONT, {"ate": 0.02}, prefer="runtime")[0] == "middle"  # the limit itself is within
    assert choose(FRONT, {"runtime": 0.15}, prefer="ate")[0] == "middle"
    assert choose(FRONT, {}, prefer="ate")[0] == "accurate"


def test_choose_reads_a_maximised_objective_as_a_lower_bound():
    assert choose(FRONT, {"rate": 8.0}, prefer="ate", maximise={"rate"})[0] == "middle"
    assert choose(FRONT, {"ate": 0.1}, prefer="rate", maximise={"rate"})[0] == "fast"


def test_choose_says_which_limit_nothing_keeps():
    with pytest.raises(NothingWithinLimitsError, match=r"ate within 0.005: the best is 0.01"):
        choose(FRONT, {"ate": 0.005}, prefer="runtime")
    with pytest.raises(NothingWithinLimitsError, match="keeps all"):
        choose(FRONT, {"ate": 0.01, "runtime": 0.05}, prefer="runtime")
    with pytest.raises(NothingWithinLimitsError, match="empty"):
        choose([], {}, prefer="runtime")
    with pytest.raises(ObjectiveError, match="'power'"):
        choose(FRONT, {"power": 1.0}, prefer="runtime")


@pytest.mark.slow
def test_black_scholes_has_its_published_front_of_88_points():
    data = os.environ.get("FRONTRUNNER_DATA")
    if not data:
        pytest.skip("FRONTRUNNER_DATA is not set: the exhaustive BlackScholes table is not at hand")
    folder = Path(data) / "dse" / "hypermapper"

    def points(name):
        with (folder / name).open(newline="") as file:
            valid = [row for row in csv.DictReader(file) if row.get("Valid", "true").lower() == "true"]
        return np.array([[float(row["ALMs"]), float(row["Cycles"])] for row in valid])

    measured = points("BlackScholes_exhaustive_search_data.csv")
    front = measured[nondominated(measured)]
    assert len(front) == 88
    assert sorted(map(tuple, front)) == sorted(map(tuple, points("BlackScholes_real_pareto.csv")))


def test_the_front_module_imports_numpy_and_nothing_heavier():
    heavy = ["sklearn", "scipy", "moocore", "plotly"]
    program = f"import pareto.fronts.front, sys; print([name for name in {heavy} if name in sys.modules])"
    answer = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert answer.stdout.strip() == "[]"
