"""Scenario files of HyperMapper: what is read from them and what is refused."""

import copy
import os
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pareto.errors import ConstraintError, ParetoError, ScenarioError, SpaceError
from pareto.spaces.scenario import Scenario

SCENARIO = {
    "application_name": "toy",
    "optimization_objectives": ["Value", "Energy"],
    "design_of_experiment": {"doe_type": "random sampling", "number_of_samples": 10},
    "optimization_iterations": 50,
    "feasible_output": {"name": "Valid", "true_value": "yes"},
    "input_parameters": {
        "x1": {"parameter_type": "ordinal", "values": [3, 1, 2], "parameter_default": 1, "prior": "decay"},
        "x2": {"parameter_type": "real", "values": [0, 8], "parameter_default": 3.9},
        "x3": {"parameter_type": "integer", "values": [-1, 1]},
        "x4": {"parameter_type": "categorical", "values": ["a", "b"], "parameter_default": "b"},
    },
}


def inputs(kind, values, **more):
    """A scenario's parameters: one, of these `values`."""
    return {"input_parameters": {"x": {"parameter_type": kind, "values": values, **more}}}


def test_a_scenario_gives_space_objectives_feasibility_and_budgets():
    scenario = Scenario.from_dict(SCENARIO, real_count=9)
    assert scenario.space.shape == (3, 9, 3, 2)
    assert scenario.space.default == {"x1": 1, "x2": 4.0, "x3": 0, "x4": "b"}
    assert [objective.name for objective in scenario.objectives] == ["Value", "Energy"]
    assert scenario.feasible == ("Valid", "yes")
    assert (scenario.initial, scenario.iterations) == (10, 50)


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"input_parameters": {}}, ScenarioError, "map names"),
        ({"input_parameters": {"x": [1, 2]}}, ScenarioError, "'x' must have a type and values"),
        (inputs("permutation", [3]), ScenarioError, "permutation"),
        (inputs("real", [1]), ScenarioError, "minimum, maximum"),
        (inputs("real", [2, 1]), SpaceError, "minimum < maximum"),
        (inputs("real", [0, 1], parameter_default="a"), ScenarioError, "default 'a' is not a number"),
        (inputs("real", [0, 1], parameter_default=3), ScenarioError, "default 3 is not in 0.0 .. 1.0"),
        (inputs("ordinal", [1, 2], constraints="x>1"), ScenarioError, "list of texts"),
        (inputs("ordinal", [1], constraints=["z > 1"]), SpaceError, "unknown parameter 'z'"),
        ({"optimization_iterations": "many"}, ScenarioError, "whole number"),
        ({"feasible_output": "Valid"}, ScenarioError, "feasible_output must be an object"),
        ({"design_of_experiment": [10]}, ScenarioError, "design_of_experiment must be an object"),
        ({"optimization_objectives": 5}, ScenarioError, "list of names, not 5"),
        ({"optimization_objectives": [["Value"]]}, ScenarioError, "list of names"),
    ],
)
def test_a_scenario_that_cannot_be_read_says_why(change, error, message):
    with pytest.raises(error, match=message):
        Scenario.from_dict({**SCENARIO, **change})


def test_what_has_no_effect_is_said_and_why():
    scenario = Scenario.from_dict({**SCENARIO, "time_budget": 5, "models": {}, "log_file": "a", "colour": 1})
    notes = "\n".join(scenario.notes)
    assert "time_budget has no effect: the budget counts evaluations" in notes
    assert "models has no effect" in notes
    assert "colour has no effect: no such field is known" in notes
    assert "x2" not in notes
    assert (
        "doe_type of design_of_experiment has no effect: the search method has a design of its own" in notes
    )
    assert "feasible_output" not in notes


def test_the_values_of_reals_are_said_where_they_are_counted():
    notes = Scenario.from_dict(SCENARIO, real_count=33).notes
    assert "real parameters take 33 values: x2" in notes
    assert "x2: its default 3.9 becomes the nearest value, 4" in notes


def test_an_unknown_field_is_said_wherever_it_stands():
    fields = {"feasible_output": {"nmae": "Valid"}, "hypermapper_mode": {"mode": "default"}}
    fields |= inputs("integer", [1, 9], defualt=3)
    scenario = Scenario.from_dict({"optimization_objectives": ["a"], **fields})
    assert scenario.notes == ("nmae of feasible_output, defualt of x have no effect: no such field is known",)
    assert scenario.space.default == {"x": 5}


ANY = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-3, 3)
    | st.floats(-3, 3)
    | st.sampled_from(["", "a", "real", "log"]),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from(["a", "name"]), inner, max_size=2)
    ),
    max_leaves=3,
)
PLACES = [
    ("application_name",),
    ("optimization_objectives",),
    ("optimization_iterations",),
    ("evaluations_per_optimization_iteration",),
    ("hypermapper_mode",),
    ("hypermapper_mode", "exhaustive_search_file"),
    ("design_of_experiment", "number_of_samples"),
    ("feasible_output", "name"),
    ("feasible_output", "true_value"),
    ("input_parameters",),
    *(
        ("input_parameters", name, field)
        for name in ("x1", "x2", "x3", "x4")
        for field in ("parameter_type", "values", "parameter_default", "prior", "constraints", "transform")
    ),
]


@settings(deadline=None, max_examples=200)
@given(st.sampled_from(PLACES), ANY)
def test_a_wrong_value_anywhere_is_read_or_refused_but_never_crashes(place, value):
    described = copy.deepcopy({**SCENARIO, "hypermapper_mode": {"mode": "exhaustive"}})
    inner = described
    for field in place[:-1]:
        inner = inner[field]
    inner[place[-1]] = value
    try:
        scenario = Scenario.from_dict(described, real_count=5)
    except ParetoError:
        return
    assert scenario.space.allowed([scenario.space.encode(scenario.space.default)])[0]


def test_a_scenario_without_surprises_has_no_notes():
    plain = inputs("integer", [1, 9], parameter_default=2, prior="uniform")
    scenario = Scenario.from_dict({"optimization_objectives": ["a"], **plain})
    assert scenario.notes == ()
    assert scenario.budget is None


def test_the_budget_is_the_design_and_every_round_of_the_search():
    assert Scenario.from_dict(SCENARIO).budget == 60
    batches = {**SCENARIO, "evaluations_per_optimization_iteration": 4}
    assert Scenario.from_dict(batches).budget == 10 + 4 * 50


def test_an_exhaustive_scenario_names_its_table():
    mode = {"mode": "exhaustive", "exhaustive_search_file": "all.csv"}
    assert Scenario.from_dict({**SCENARIO, "hypermapper_mode": mode}).table == "all.csv"


def test_feasibility_has_hypermappers_own_defaults():
    scenario = Scenario.from_dict({**SCENARIO, "feasible_output": {"enable_feasible_predictor": True}})
    assert scenario.feasible == ("Valid", "true")


def test_constraints_of_parameters_become_those_of_the_space_and_move_defaults_nobody_gave():
    linked = {
        "stride": {"parameter_type": "ordinal", "values": [1, 2, 4, 8], "transform": "log"},
        "size": {
            "parameter_type": "ordinal",
            "values": [1, 2, 4, 8, 16],
            "parameter_default": 2,
            "constraints": ["size % stride == 0", "(size > 1) & (stride < 8)"],
            "dependencies": ["stride"],
        },
    }
    scenario = Scenario.from_dict({"optimization_objectives": ["a"], "input_parameters": linked})
    assert [item.text for item in scenario.space.constraints] == linked["size"]["constraints"]
    assert scenario.space.default == {"stride": 2, "size": 2}
    assert scenario.notes == ("constraints forbid the middle of stride: a value near it is the default",)
    linked["stride"]["parameter_default"] = 4
    with pytest.raises(ConstraintError, match="the default breaks"):
        Scenario.from_dict({"optimization_objectives": ["a"], "input_parameters": linked})


def test_a_logarithmic_real_parameter_is_spaced_so():
    fields = {"optimization_objectives": ["a"], **inputs("real", [0.001, 1], transform="log")}
    scenario = Scenario.from_dict(fields, real_count=4)
    assert scenario.space.parameters[0].values == pytest.approx((0.001, 0.01, 0.1, 1.0))


def test_a_space_is_not_mistaken_for_a_scenario():
    with pytest.raises(ScenarioError, match="input_parameters"):
        Scenario.from_dict({"parameters": []})


def test_the_published_black_scholes_scenario_is_read():
    data = os.environ.get("FRONTRUNNER_DATA")
    if not data:
        pytest.skip("FRONTRUNNER_DATA is not set: the BlackScholes scenario is not at hand")
    scenario = Scenario.load(Path(data) / "dse" / "hypermapper" / "BlackScholes_scenario.json")
    assert len(scenario.space) == 76_800
    assert scenario.feasible == ("Valid", "true")
    assert scenario.space.default == {"B": 96, "OP": 1, "IP": 1, "x1873": "false"}
