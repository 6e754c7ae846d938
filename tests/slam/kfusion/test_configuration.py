"""What KinectFusion accepts as a configuration, and what it says of the rest."""

from __future__ import annotations

import pytest

from slam.configuration import ConfigurationError
from slam.kfusion.configuration import ANDROID_APP, DEFAULT, Configuration


def test_absent_parameters_take_slambench_defaults():
    assert Configuration.from_mapping({}) == DEFAULT
    assert DEFAULT.iterations == (10, 5, 4)
    assert (DEFAULT.compute_size_ratio, DEFAULT.integration_rate, DEFAULT.volume_resolution) == (1, 2, 256)


def test_a_configuration_survives_its_dictionary():
    for configuration in ANDROID_APP.values():
        assert Configuration.from_mapping(configuration.to_dict()) == configuration


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
