"""Input that an explorer refuses, saying what would be right, and input that only looks odd."""

import json
import math

import numpy as np
import pytest

from pareto import Explorer
from pareto.errors import (
    ConfigurationError,
    DamagedStateError,
    MethodError,
    ObjectiveError,
    SpaceError,
    StateError,
)
from tests.builders.spaces import space_of

SPACE = space_of(x=range(100))


@pytest.fixture
def state():
    """The state of an explorer that knows two measurements and waits for one."""
    explorer = Explorer(SPACE, ("error", "seconds"), {"error": 1.0}, seed=3)
    explorer.tell([{"x": 5}, {"x": 6}], [{"error": 0.5, "seconds": 2.0}, None])
    explorer.ask(1)
    return json.loads(json.dumps(explorer.state()))


@pytest.mark.parametrize("damaged", ["[]", "3", "null", '"text"'])
def test_a_state_that_is_no_object_is_refused(damaged):
    with pytest.raises(StateError, match="not an object"):
        Explorer.restore(SPACE, json.loads(damaged))


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("observations", [["q", "random", [None]]], "'str'"),
        ("observations", [[1.5, "random", [None]]], "'float'"),
        ("observations", [[99999, "random", [None]]], r"index 99999 is outside 0 \.\. 99"),
        ("observations", [[-1, "random", [None]]], r"index -1 is outside 0 \.\. 99"),
        ("observations", [[5, "random", [[0.5]]]], "shorter"),
        ("observations", [[5, "random", [[0.5, 2.0, 9.0]]]], "longer"),
        ("observations", [[5, "random", [[0.5, "fast"]]]], "'fast'"),
        ("observations", [[5, "random", [[0.5, float("nan")]]]], "nan"),
        ("observations", [[5, "random", 7]], "not iterable"),
        ("observations", [[5, "random"]], "not enough values"),
        ("prior", [[100, "told", [None]]], r"index 100 is outside 0 \.\. 99"),
        ("pending", [["q", "random"]], "'str'"),
        ("pending", [[99999, "random"]], r"index 99999 is outside 0 \.\. 99"),
        ("asks", -1, "asked -1 times"),
        ("memory", [], "TypeError"),
        ("limits", [1], "map objectives to numbers"),
        ("method", ["random"], r"no method \['random'\]"),
        ("limits", {"watts": 1.0}, "'watts'"),
        ("objectives", ["error"], "damaged"),
        ("options", {"forests": 3}, "'forests'"),
        ("method", "annealing", "'annealing'"),
        ("seed", "x", "'x'"),
        ("asks", float("inf"), "infinity"),
    ],
)
def test_a_damaged_state_is_refused_whatever_is_wrong_with_it(state, field, value, message):
    Explorer.restore(SPACE, state)
    with pytest.raises(StateError, match=message):
        Explorer.restore(SPACE, {**state, field: value})


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("shortlist", [100], r"index 100 is outside 0 \.\. 99"),
        ("shortlist", ["q"], "'str'"),
        ("shortlist", None, "not iterable"),
        ("hyperparameters", {"0": [0.0]}, "4 numbers below 100"),
        ("hyperparameters", {"0": [0.0, 0.0, 0.0, 1e9]}, "1000000000"),
        ("hyperparameters", {"0": [0.0, 0.0, 0.0, math.nan]}, "nan"),
        ("hyperparameters", [], "AttributeError"),
        ("success", {"near": {"good": [100], "bad": [], "seed": 1}}, r"index 100 is outside 0 \.\. 99"),
        ("success", {"near": {"good": [1], "bad": [2]}}, "seed"),
        ("success", {"near": {"good": [1], "bad": [2], "seed": "x"}}, "'x'"),
        ("success", {"near": {"good": [1], "bad": [2], "seed": -1}}, "seed -1"),
        ("success", {"near": {"good": [], "bad": [], "seed": 1}}, "model of success"),
        ("success", None, "AttributeError"),
        ("since", "often", "'often'"),
        ("since", math.inf, "infinity"),
        ("ahead", [7], "non-iterable"),
        ("ahead", [[100, "active"]], r"index 100 is outside 0 \.\. 99"),
        ("ahead", [[7, "sideways"]], "'sideways'"),
        ("ahead", [[7, ["active"]]], "active"),
        ("until", None, "NoneType"),
        ("until", math.nan, "nan|NaN"),
    ],
)
def test_a_damaged_memory_is_refused_whatever_is_wrong_with_it(state, field, value, message):
    memory = {
        "shortlist": [7],
        "hyperparameters": {"0": [0.0] * 4, "1": [0.0] * 4},
        "success": {"measurable": {"good": [5], "bad": [6], "seed": 1}},
        "since": 1,
        "ahead": [[7, "active"], [5, "again"]],
        "until": 3,
    }
    restored = Explorer.restore(SPACE, {**state, "memory": memory})
    assert restored.state()["memory"] == memory
    with pytest.raises(DamagedStateError, match=message):
        Explorer.restore(SPACE, {**state, "memory": {**memory, field: value}})
    del memory[field]
    if field != "hyperparameters":  # without which it is taken for that of an earlier program
        with pytest.raises(DamagedStateError, match=field):
            Explorer.restore(SPACE, {**state, "memory": memory})


def test_methods_and_options_of_an_earlier_program_are_refused():
    with pytest.raises(MethodError, match="'bayesian' has no option 'trees'"):
        Explorer(SPACE, ("error",), method="bayesian", trees=8)
    with pytest.raises(MethodError, match="no method 'two-stage': there are bayesian"):
        Explorer(SPACE, ("error",), method="two-stage")


def test_tell_needs_one_result_for_each_configuration():
    explorer = Explorer(SPACE, ("error",))
    with pytest.raises(ObjectiveError, match="1 results for 2 configurations: tell one each"):
        explorer.tell([{"x": 1}, {"x": 2}], [{"error": 1.0}])
    assert explorer.history.results == {}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (({"x": 1}, {"error": 1.0}), r"tell\(\[configuration\], \[values\]\)"),
        (([{"x": 1}], {"error": 1.0}), "two lists"),
        ((None, None), "two lists"),
        (([3], [{"error": 1.0}]), "maps parameters to values, 3 does not"),
        (([None], [{"error": 1.0}]), "None does not"),
    ],
)
def test_tell_takes_lists_of_configurations_and_results(arguments, message):
    explorer = Explorer(SPACE, ("error",))
    with pytest.raises(ConfigurationError, match=message):
        explorer.tell(*arguments)
    assert explorer.history.results == {}


def test_what_is_forgotten_comes_in_a_list():
    explorer = Explorer(SPACE, ("error",))
    [asked] = explorer.ask(1)
    for forgotten, message in ((asked, "takes a list"), ([3], "3 does not")):
        with pytest.raises(ConfigurationError, match=message):
            explorer.forget(forgotten)
    assert explorer.pending() == [asked]


@pytest.mark.parametrize(
    ("wrong", "error", "message"),
    [
        ({"space": "line.json"}, SpaceError, r"not 'line.json': Space\.load"),
        ({"objectives": 3}, ObjectiveError, "a list of names, not 3"),
        ({"limits": [1.0]}, ObjectiveError, r"map objectives to numbers, not \[1\.0\]"),
        ({"method": ["random"]}, MethodError, r"no method \['random'\]"),
        ({"prior": [({"x": 1},)]}, ObjectiveError, "pairs, not"),
        ({"prior": [3]}, ObjectiveError, "pairs, not 3"),
    ],
)
def test_what_an_explorer_is_made_of_has_the_right_types(wrong, error, message):
    with pytest.raises(error, match=message):
        Explorer(**{"space": SPACE, "objectives": ("error",), **wrong})


@pytest.mark.parametrize("size", [400, 5000])
def test_a_number_too_large_for_a_float_is_refused(size):
    explorer = Explorer(SPACE, ("error",))
    with pytest.raises(ObjectiveError, match="error is too large"):
        explorer.tell([{"x": 1}], [{"error": 10**size}])
    with pytest.raises(ObjectiveError, match="error is too large"):
        Explorer(SPACE, ("error",), {"error": -(10**size)})
    assert explorer.history.results == {}


def test_an_array_is_a_value_only_if_it_holds_one():
    explorer = Explorer(SPACE, ("error",))
    with pytest.raises(ObjectiveError, match="not a finite number"):
        explorer.tell([{"x": 1}], [{"error": np.array([1.0, 2.0])}])
    explorer.tell([{"x": 1}], [{"error": np.array(1.5)}])
    assert explorer.front() == [({"x": 1}, {"error": 1.5})]


def test_counts_and_seeds_are_whole_numbers():
    explorer = Explorer(SPACE, ("error",), method="random")
    for count in (2.5, "3", None):
        with pytest.raises(MethodError, match=r"count = .* is not a whole number"):
            explorer.ask(count)
    assert explorer.state()["asks"] == 0
    assert len(explorer.ask(np.int64(3))) == 3
    for seed in ("x", 0.5, None):
        with pytest.raises(MethodError, match=r"seed = .* is not a whole number"):
            Explorer(SPACE, ("error",), seed=seed)


def test_numpys_whole_numbers_are_options_like_any_others():
    explorer = Explorer(SPACE, ("error",), seed=np.int64(3), initial=np.int64(30))
    plain = Explorer(SPACE, ("error",), seed=3, initial=30)
    assert json.loads(json.dumps(explorer.state())) == plain.state()
    assert explorer.ask(30) == plain.ask(30)
