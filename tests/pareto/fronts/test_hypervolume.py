"""The hypervolume against counted cells, and its growth over an exploration."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from pareto.errors import ObjectiveError
from pareto.fronts.hypervolume import hypervolume, hypervolume_growth, reference_point


@settings(max_examples=100)
@given(
    st.integers(1, 4).flatmap(
        lambda m: hnp.arrays(
            float, st.tuples(st.integers(0, 12), st.just(m)), elements=st.integers(0, 6).map(float)
        )
    )
)
def test_the_hypervolume_of_whole_numbers_is_a_count_of_unit_cells(points):
    objectives = points.shape[1]
    corners = np.stack(np.meshgrid(*[np.arange(5.0)] * objectives), axis=-1).reshape(-1, objectives)
    dominated = (points[:, None] <= corners[None]).all(axis=2).any(axis=0)
    assert hypervolume(points, [5.0] * objectives) == pytest.approx(dominated.sum())


def test_later_points_do_not_move_the_reference():
    points = np.array([[1.0, 20.0], [np.nan, np.nan], *[[3.0, 10.0]] * 9, [500.0, 1.0]])
    assert reference_point(points).tolist() == reference_point(points[:11]).tolist() == [3.0, 20.0]


def test_the_reference_is_the_limit_or_the_worst_value():
    points = np.array([[1.0, 20.0], [3.0, 10.0], [np.nan, 99.0]])
    assert reference_point(points).tolist() == [3.0, 20.0]
    assert reference_point(points, [5.0, None]).tolist() == [5.0, 20.0]
    assert reference_point(points, None, maximise=[False, True]).tolist() == [3.0, 10.0]
    with pytest.raises(ObjectiveError, match="nothing was measured"):
        reference_point(points[2:])
    with pytest.raises(ObjectiveError, match="1 limits do not fit 2"):
        reference_point(points, [1.0])


@settings(max_examples=60)
@given(st.integers(0, 2**32 - 1), st.integers(1, 3), st.booleans())
def test_each_step_of_the_growth_is_the_hypervolume_so_far(seed, objectives, negative):
    rng = np.random.default_rng(seed)
    points = np.round(rng.lognormal(size=(15, objectives)), 1) + 0.1
    points[rng.random(15) < 0.2] = np.nan
    points *= -1 if negative else 1
    maximise = (rng.random(objectives) < 0.5).tolist()
    limits = [float(np.nanmedian(points)) if rng.random() < 0.5 else None for _ in range(objectives)]
    growth = hypervolume_growth(points, limits, maximise)
    if np.isnan(points).all():
        assert not growth.any()
        return
    reference = reference_point(points, limits, maximise)
    so_far = [
        hypervolume(points[: count + 1], reference, maximise, log=not negative)
        for count in range(len(points))
    ]
    np.testing.assert_allclose(growth, so_far, rtol=1e-9, atol=1e-12)
    assert (np.diff(growth) >= 0).all()


def test_nothing_measured_has_no_volume():
    assert hypervolume_growth(np.empty((0, 2))).shape == (0,)
    assert hypervolume_growth(np.full((3, 2), np.nan)).tolist() == [0.0, 0.0, 0.0]


def test_hypervolume_of_known_areas():
    points = [[1.0, 3.0], [2.0, 1.0], [9.0, 9.0], [np.nan, 0.0]]
    assert hypervolume(points, [4.0, 4.0]) == pytest.approx(7.0)
    assert hypervolume([[2.0], [1.0]], [4.0]) == 3.0
    assert hypervolume([[1.0, 1.0]], [np.e, np.e], log=True) == pytest.approx(1.0)
    assert hypervolume([[3.0, 1.0]], [1.0, 4.0], maximise=[True, False]) == pytest.approx(2.0 * 3.0)
    assert hypervolume([], [1.0, 1.0]) == 0.0
    assert hypervolume([[5.0, 5.0]], [1.0, 1.0]) == 0.0


def test_hypervolume_refuses_what_does_not_fit():
    with pytest.raises(ObjectiveError, match="do not fit"):
        hypervolume([[1.0, 2.0]], [1.0])
    with pytest.raises(ObjectiveError, match="logarithm"):
        hypervolume([[-1.0, 2.0]], [1.0, 3.0], log=True)
