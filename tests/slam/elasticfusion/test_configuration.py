"""What ElasticFusion accepts as a configuration, and what it says of the rest."""

from __future__ import annotations

import json
from dataclasses import fields
from pathlib import Path

import pytest

from slam.configuration import ConfigurationError
from slam.elasticfusion.configuration import DEFAULT, Configuration

SPACES = Path(__file__).parents[3] / "pareto" / "spaces"


@pytest.mark.parametrize("space", ["elasticfusion", "elasticfusion-loops", "elasticfusion-ratio"])
def test_the_parameters_of_the_space_come_first_with_its_defaults_and_take_all_its_values(space):
    parameters = json.loads((SPACES / f"{space}.json").read_text())["parameters"]
    assert [field.name for field in fields(Configuration)][: len(parameters)] == [
        p["name"] for p in parameters
    ]
    for parameter in parameters:
        assert getattr(DEFAULT, parameter["name"]) == parameter["default"]
        for value in parameter.get("values", (False, True)):
            taken = Configuration.from_mapping({parameter["name"]: value}).to_dict()[parameter["name"]]
            assert taken == value
            assert isinstance(taken, bool) == isinstance(value, bool)


def test_a_configuration_survives_its_dictionary():
    chosen = Configuration(icp_weight=0.5, open_loop=True, time_window=50, seed=3)
    assert Configuration.from_mapping(json.loads(json.dumps(chosen.to_dict()))) == chosen


def test_flags_may_come_as_0_and_1():
    assert Configuration.from_mapping({"open_loop": 1, "relocalisation": 0}) == Configuration(
        open_loop=True, relocalisation=False
    )


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"mu": 0.1}, "unknown parameter mu: ElasticFusion has icp_weight"),
        ({"icp_weight": -1}, "icp_weight=-1.0: must be 0"),
        ({"icp_weight": float("inf")}, "icp_weight=inf: must be a finite number"),
        ({"depth_cutoff": 0.2}, "depth_cutoff=0.2: must be above 0.3 and at most 20"),
        ({"depth_cutoff": 25}, "depth_cutoff=25.0: must be above 0.3"),
        ({"confidence_threshold": 2.5}, "confidence_threshold=2.5: must be a whole number"),
        ({"confidence_threshold": 0}, "confidence_threshold=0: must be at least 1"),
        ({"disable_so3": 2}, "disable_so3=2: must be true or false"),
        ({"fast_odometry": "yes"}, "fast_odometry='yes': must be true or false"),
        ({"icp_deviation_threshold": 0}, "icp_deviation_threshold=0.0: must be above 0"),
        ({"compute_size_ratio": 0}, "compute_size_ratio=0: must be at least 1"),
        ({"surfel_capacity": 0}, "surfel_capacity=0: must be at least 1"),
    ],
)
def test_bad_values_are_named_with_what_would_be_right(values, words):
    with pytest.raises(ConfigurationError, match=words):
        Configuration.from_mapping(values)
