"""Where an exploration has no answer it says so by a typed error, and the search goes on."""

import pytest

from pareto import Explorer, Objective
from pareto.errors import (
    AllFailedError,
    ConstantObjectiveError,
    NoAnswerError,
    NothingFeasibleError,
    NothingMeasuredError,
)
from tests.builders.spaces import space_of

SPACE = space_of(x=range(1, 61))


def explored(values, objectives=("error", "seconds"), limits=None, count=30):
    explorer = Explorer(SPACE, objectives, limits, initial=10, candidates=20)
    while len(explorer.history.results) < count:
        asked = explorer.ask(10)
        explorer.tell(asked, [values(item["x"]) for item in asked])
    return explorer


@pytest.mark.parametrize(
    ("values", "limits", "error", "message"),
    [
        (lambda _: None, None, AllFailedError, "all 39 configurations failed"),
        (lambda x: {"error": 1, "seconds": x}, {"seconds": 0.5}, NothingFeasibleError, "seconds <= 0.5.*= 1"),
        (lambda _: {"error": 7, "seconds": 2}, None, ConstantObjectiveError, "'error' .7. and 'seconds' .2."),
    ],
)
def test_what_has_no_answer_is_named_and_explored_on(values, limits, error, message):
    explorer = explored(values, limits=limits)
    with pytest.raises(error, match=message) as raised:
        explorer.answer()
    assert isinstance(raised.value, NoAnswerError)
    assert len(explorer.ask(5)) == 5


def test_before_the_first_measurement_there_is_no_answer():
    with pytest.raises(NothingMeasuredError, match=r"call ask\(\) for configurations"):
        Explorer(SPACE, ("error",)).answer()


def test_a_limit_from_below_is_named_the_right_way_round():
    explorer = explored(lambda x: {"rate": x}, [Objective("rate", maximise=True)], {"rate": 99})
    with pytest.raises(NothingFeasibleError, match="rate >= 99; the best of each are rate ="):
        explorer.answer()


def test_one_constant_objective_withholds_no_front():
    explorer = explored(lambda x: {"error": 7, "seconds": x})
    assert explorer.answer() == explorer.front() != []


def test_an_answer_is_the_front():
    explorer = explored(lambda x: {"error": x, "seconds": 1 / x})
    assert explorer.answer() == explorer.front()
