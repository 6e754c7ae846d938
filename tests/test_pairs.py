"""The cover of a grid's pairs, on which the choice between `make test-slow` and `make test-all` rests."""

import itertools

import pytest

from tests.pairs import pairs

AXES = ("abc", range(4), (True, False), "xyz")


def kept(grid):
    return [cell.values for cell in grid if not cell.marks]


def test_each_value_meets_each_value_of_every_other_axis():
    chosen = kept(pairs(*AXES))
    for one, other in itertools.combinations(range(len(AXES)), 2):
        assert {(cell[one], cell[other]) for cell in chosen} == set(itertools.product(AXES[one], AXES[other]))


def test_the_whole_grid_is_there_and_most_of_it_is_left_for_test_all():
    grid = pairs(*AXES)
    assert [cell.values for cell in grid] == list(itertools.product(*AXES))
    assert len(kept(grid)) < len(grid) / 3


def test_values_keep_their_ids():
    assert {cell.id for cell in pairs([pytest.param(len, id="length")], "ab", [3])} == {
        "length-a-3",
        "length-b-3",
    }
