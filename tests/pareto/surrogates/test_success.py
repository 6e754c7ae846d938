"""Chances to succeed: learned from both, never certain, and the same after a restart."""

import json

import numpy as np
import pytest

from pareto.errors import StateError
from pareto.surrogates.success import Success
from tests.builders.spaces import space_of

SPACE = space_of(x=range(20), y=range(10))
EVERYTHING = np.arange(len(SPACE))
WORKS = SPACE.codes(EVERYTHING)[:, 0] < 8


def some(seed=0):
    known = np.random.default_rng(seed).permutation(len(SPACE))[:80]
    return Success(SPACE, known[WORKS[known]], known[~WORKS[known]], seed=5)


def test_chances_follow_what_succeeded_and_leave_nothing_certain():
    chance = some().chance(EVERYTHING)
    assert chance[WORKS].mean() > 0.9
    assert chance[~WORKS].mean() < 0.1
    assert (chance > 0).all()
    assert (chance < 1).all()


@pytest.mark.parametrize(("good", "bad"), [([], [3, 4]), ([3, 4], []), ([3], [4])])
def test_one_kind_alone_is_enough(good, bad):
    good, bad = (np.array(indices, dtype=np.int64) for indices in (good, bad))
    chance = Success(SPACE, good, bad, seed=1).chance(EVERYTHING)
    assert (chance > 0).all()
    assert (chance < 1).all()
    if not len(good):
        assert chance.max() < 0.5
    if not len(bad):
        assert chance.min() > 0.5


def test_what_is_saved_gives_the_same_chances():
    first = some()
    again = Success.read(json.loads(json.dumps(first.to_dict())), SPACE)
    assert len(again) == len(first) == 80
    np.testing.assert_array_equal(again.chance(EVERYTHING), first.chance(EVERYTHING))


def test_what_is_damaged_is_refused():
    saved = some().to_dict()
    for field, value in (("good", [200]), ("bad", [-1]), ("seed", -3)):
        with pytest.raises(StateError):
            Success.read({**saved, field: value}, SPACE)
    with pytest.raises(StateError):
        Success.read({"good": [], "bad": [], "seed": 1}, SPACE)
