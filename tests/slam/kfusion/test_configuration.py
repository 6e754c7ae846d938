"""What KinectFusion accepts as a configuration, and what it says of the rest."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pareto
from pareto import Space
from pareto.spaces.sampling import sample
from slam.configuration import ConfigurationError
from slam.definitions import without_optional
from slam.kfusion.configuration import ANDROID_APP, DEFAULT, Configuration


def test_absent_parameters_take_slambench_defaults():
    assert Configuration.from_mapping({}) == DEFAULT
    assert DEFAULT.iterations == (10, 5, 4)
    assert (DEFAULT.compute_size_ratio, DEFAULT.integration_rate, DEFAULT.volume_resolution) == (1, 2, 256)


def test_a_configuration_survives_its_dictionary():
    for configuration in ANDROID_APP.values():
        assert Configuration.from_mapping(configuration.to_dict()) == configuration


def test_every_point_of_the_adaptive_space_can_be_run():
    space = Space.load(Path(pareto.__file__).parent / "spaces" / "kfusion-adaptive.json")
    for index in sample(space, 200, np.random.default_rng(0)):
        values = without_optional(space.decode(int(index)))
        assert Configuration.from_mapping(values).to_dict() == values


def test_a_fixed_configuration_is_the_same_with_and_without_the_parameters_that_adapt():
    fixed = DEFAULT.to_dict()
    unused = {"skip_limit": 0, "skip_translation": None, "integrate_translation": 0.0}
    assert len(fixed) == 9
    assert without_optional(fixed | unused) == without_optional(fixed) == fixed
    assert without_optional({"pyramid_iterations_coarse": 0, "skip_limit": 1}) == {
        "pyramid_iterations_coarse": 0,
        "skip_limit": 1,
    }


def test_whole_numbers_may_come_as_floats():
    assert Configuration.from_mapping({"volume_resolution": 128.0}).volume_resolution == 128


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"volume_size": 4}, "unknown parameter volume_size"),
        ({"mu": 0}, "mu=0.0: must be above 0"),
        ({"mu": float("nan")}, "mu=nan: must be a finite number"),
        ({"mu": "wide"}, "mu='wide': must be a finite number"),
        ({"icp_threshold": -1}, "icp_threshold=-1.0: must be 0 or more"),
        ({"tracking_rate": 0}, "tracking_rate=0: must be at least 1"),
        ({"integration_rate": 2.5}, "integration_rate=2.5: must be a whole number"),
        ({"volume_resolution": True}, "volume_resolution=True: must be a whole number"),
        ({"volume_resolution": float("inf")}, "volume_resolution=inf: must be a whole number"),
        ({"pyramid_iterations_fine": -1}, "must be at least 0"),
        (
            {"pyramid_iterations_fine": 0, "pyramid_iterations_middle": 0, "pyramid_iterations_coarse": 0},
            "all three pyramid_iterations are 0",
        ),
    ],
)
def test_bad_values_are_named_with_what_would_be_right(values, words):
    with pytest.raises(ConfigurationError, match=words.replace("(", r"\(")):
        Configuration.from_mapping(values)
