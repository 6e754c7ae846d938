"""Scenario files of HyperMapper: what is read from them and what is refused."""

import os
from pathlib import Path

import pytest

from pareto.errors import ScenarioError, SpaceError
from pareto.scenario import Scenario

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
        (
            {"input_parameters": {"x": {"parameter_type": "permutation", "values": [3]}}},
            ScenarioError,
            "permutation",
        ),
        (
            {"input_parameters": {"x": {"parameter_type": "real", "values": [1]}}},
            ScenarioError,
            "minimum, maximum",
        ),
        (
            {"input_parameters": {"x": {"parameter_type": "real", "values": [2, 1]}}},
            SpaceError,
            "minimum < maximum",
        ),
        ({"optimization_iterations": "many"}, ScenarioError, "whole number"),
        ({"feasible_output": {"true_value": "x"}}, ScenarioError, "needs a name"),
    ],
)
def test_a_scenario_that_cannot_be_read_says_why(change, error, message):
    with pytest.raises(error, match=message):
        Scenario.from_dict({**SCENARIO, **change})


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
