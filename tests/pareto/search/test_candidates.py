"""The points that a search looks at: allowed, free, and where they may succeed."""

import numpy as np
import pytest

from pareto.fronts.objective import Objective
from pareto.search.candidates import front_neighbours, likely_points, neighbours, pool
from pareto.search.history import History
from pareto.search.targets import Targets
from pareto.surrogates.success import Success
from tests.builders.spaces import space_of
from tests.pareto.searches import SPACE

GRID = space_of(x=range(100), y=range(100), z=range(100))
DIAGONAL = space_of("x <= y + 1", "y <= x + 1", x=range(100), y=range(100))


def targets_of(space, count=30):
    history = History(space, (Objective("a"), Objective("b")), {})
    allowed = space.region.at(np.linspace(0, space.region.size - 1, count).astype(np.int64))
    for index in allowed.tolist():
        codes = space.codes([index])[0]
        history.record(index, (1.0 + float(codes[0]), 200.0 - float(codes[0]) + float(codes[-1])))
    return history, Targets.of(history)


def test_where_the_allowed_part_is_small_all_of_it_is_looked_at():
    assert len(DIAGONAL) == 10_000
    history, targets = targets_of(DIAGONAL)
    candidates = pool(targets, DIAGONAL, None, 298, history.taken(), np.random.default_rng(0))
    everything = np.flatnonzero(DIAGONAL.allowed_grid)
    assert len(everything) == 298
    np.testing.assert_array_equal(candidates, np.setdiff1d(everything, [*history.results]))


def test_otherwise_half_is_drawn_and_half_are_neighbours_of_the_front():
    history, targets = targets_of(GRID)
    taken = history.taken() | {5, 6}
    candidates = pool(targets, GRID, None, 200, taken, np.random.default_rng(0))
    around = front_neighbours(targets, GRID)
    assert 190 <= len(candidates) <= 200
    assert (np.diff(candidates) > 0).all()
    assert not set(candidates.tolist()) & taken
    assert 90 <= np.isin(candidates, around).sum() <= 110


@pytest.mark.parametrize("count", [10, 100])
def test_with_constraints_every_point_is_allowed(count):
    history, targets = targets_of(DIAGONAL)
    candidates = pool(targets, DIAGONAL, None, count, history.taken(), np.random.default_rng(0))
    assert 0 < len(candidates) <= count
    assert DIAGONAL.allowed(candidates).all()


def test_an_exhausted_space_leaves_nothing_to_look_at():
    history, targets = targets_of(SPACE, len(SPACE))
    for count in (100, 2000):
        assert len(pool(targets, SPACE, None, count, history.taken(), np.random.default_rng(0))) == 0


def test_neighbours_differ_in_one_parameter():
    index = GRID.encode({"x": 5, "y": 5, "z": 5})
    indices = neighbours(np.array([index]), GRID)
    assert ((GRID.codes(indices) != 5).sum(axis=1) == 1).all()
    assert index not in indices
    assert len(neighbours(np.empty(0, dtype=np.int64), GRID)) == 0


def test_where_nearly_everything_fails_likely_points_are_mostly_those_that_do_not():
    codes = SPACE.codes(np.arange(len(SPACE)))
    works = (codes[:, 1] == 2) & (codes[:, 2] != 2)  # 24 of 324
    measured = np.arange(0, len(SPACE), 2)
    success = Success(SPACE, measured[works[measured]], measured[~works[measured]], seed=0)
    rng = np.random.default_rng(0)
    taken = set(measured.tolist())
    drawn = [likely_points(SPACE, success, 1, taken, rng).tolist() for _ in range(100)]
    good = sum(works[index] for [index] in drawn)
    assert 40 <= good < 100  # by chance, 7
    left = len(SPACE) - len(taken)
    assert len(set(likely_points(SPACE, success, left, taken, rng).tolist())) == left
    assert len(likely_points(SPACE, success, 0, taken, rng)) == 0
    assert len(likely_points(SPACE, None, 7, taken, rng)) == 7
