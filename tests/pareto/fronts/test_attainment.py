"""Attainment surfaces against their definition."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from pareto.errors import ObjectiveError
from pareto.fronts.attainment import attainment
from pareto.fronts.front import nondominated

RUNS = [[[1.0, 4.0], [3.0, 2.0]], [[2.0, 3.0]], [[4.0, 1.0], [5.0, 5.0]]]


def attained_by(runs, points):
    reached = [(run[:, None] <= points[None]).all(axis=2).any(axis=0) for run in runs if len(run)]
    return np.sum(reached, axis=0) if reached else np.zeros(len(points))


@pytest.mark.slow
@settings(max_examples=80)
@given(
    st.integers(1, 3).flatmap(
        lambda m: st.lists(
            hnp.arrays(
                float, st.tuples(st.integers(0, 6), st.just(m)), elements=st.integers(0, 5).map(float)
            ),
            min_size=1,
            max_size=7,
        )
    ),
    st.data(),
)
def test_a_point_is_on_or_above_the_surface_when_enough_runs_attain_it(runs, data):
    level = data.draw(st.integers(1, len(runs)))
    surface = attainment(runs, level)
    assert nondominated(surface).all()
    objectives = runs[0].shape[1]
    grid = np.stack(np.meshgrid(*[np.arange(6.0)] * objectives), axis=-1).reshape(-1, objectives)
    above = (surface[:, None] <= grid[None]).all(axis=2).any(axis=0)
    np.testing.assert_array_equal(above, attained_by(runs, grid) >= level)


def test_the_first_level_is_the_front_of_all_runs_and_the_last_what_every_run_reaches():
    assert attainment(RUNS, 1).tolist() == [[1.0, 4.0], [2.0, 3.0], [3.0, 2.0], [4.0, 1.0]]
    assert attainment(RUNS, 2).tolist() == [[2.0, 4.0], [3.0, 3.0], [4.0, 2.0]]
    assert attainment(RUNS, 3).tolist() == [[4.0, 3.0]]


def test_a_maximised_objective_is_attained_from_above():
    mirrored = [np.array(run) * [1.0, -1.0] for run in RUNS]
    surface = attainment(mirrored, 2, maximise=[False, True])
    assert surface.tolist() == [[2.0, -4.0], [3.0, -3.0], [4.0, -2.0]]


def test_a_run_of_failures_attains_nothing():
    runs = [[[np.nan, 1.0]], RUNS[1], []]
    assert attainment(runs, 1).tolist() == [[2.0, 3.0]]
    assert attainment(runs, 2).shape == (0, 2)


def test_what_has_no_surface_is_refused():
    with pytest.raises(ObjectiveError, match="level 4 of 3 runs"):
        attainment(RUNS, 4)
    with pytest.raises(ObjectiveError, match="level 1 of 0 runs"):
        attainment([], 1)
    with pytest.raises(ObjectiveError, match=r"\[2, 4\]"):
        attainment([[[1.0, 2.0]], [[1.0, 2.0, 3.0, 4.0]]], 1)
    with pytest.raises(ObjectiveError, match=r"\[4\]"):
        attainment([[[1.0, 2.0, 3.0, 4.0]]], 1)
