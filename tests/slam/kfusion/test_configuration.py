"""What KinectFusion accepts as a configuration, and what it says of the rest."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest

import pareto
from pareto import Space
from pareto.spaces.sampling import sample
from slam.configuration import ConfigurationError
from slam.definitions import without_optional
from slam.kfusion.configuration import ANDROID_APP, DEFAULT, MOST_SKIPPED, Configuration
from tests.shipped import KFUSION


def test_absent_parameters_take_slambench_defaults():
    assert Configuration.from_mapping({}) == DEFAULT
    assert DEFAULT.iterations == (10, 5, 4)
    assert (DEFAULT.compute_size_ratio, DEFAULT.integration_rate, DEFAULT.volume_resolution) == (1, 2, 256)


def test_a_configuration_survives_its_dictionary():
    adaptive = Configuration(integration_rate=1, skip_limit=3, skip_translation=0.05, skip_rotation=0.03)
    fusing = Configuration(integration_rate=1, tracking_rate=2, integrate_translation=0.05)
    for configuration in (*ANDROID_APP.values(), adaptive, fusing):
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
        ({"skip_limit": -1}, "skip_limit=-1: must be at least 0"),
        ({"skip_limit": 0.5}, "skip_limit=0.5: must be a whole number"),
        ({"skip_limit": MOST_SKIPPED + 1}, f"skip_limit={MOST_SKIPPED + 1}: must be at most {MOST_SKIPPED}"),
        ({"skip_rotation": -0.1}, "skip_rotation=-0.1: must be 0 or more"),
        ({"integrate_translation": float("nan")}, "integrate_translation=nan: must be a finite number"),
        ({"skip_limit": 1, "tracking_rate": 2}, "set tracking_rate to 1, or skip_limit to 0"),
        ({"skip_limit": 1, "integration_rate": 2}, "set integration_rate to 1, or skip_limit to 0"),
        ({"integrate_translation": 0.1}, "integration_rate=2 with integrate_translation=0.1"),
        ({"integrate_rotation": 0.1}, "set integration_rate to 1, or the other two to 0"),
    ],
)
def test_bad_values_are_named_with_what_would_be_right(values, words):
    with pytest.raises(ConfigurationError, match=words.replace("(", r"\(")):
        Configuration.from_mapping(values)


def test_a_fixed_configuration_has_nine_parameters_and_the_digest_of_before():
    """Fronts and explorations from before parameters adapted still match."""
    front = json.loads(KFUSION.read_text(encoding="utf-8"))
    points = [point["parameters"] for point in front["configurations"]]
    described = [Configuration.from_mapping(point).to_dict() for point in points]

    assert described == points
    assert {len(each) for each in described if "skip_limit" not in each} == {9}
    digest = hashlib.sha256(json.dumps(described[0], sort_keys=True).encode()).hexdigest()
    assert digest == "04cb5f4601ce43881e9208dc4f292c544a97f02644dad9d33bc8f583c5bc7045"


def test_a_parameter_that_adapts_is_described_unless_it_is_zero():
    described = Configuration(integration_rate=1, skip_limit=2, skip_translation=0.05).to_dict()

    assert described["skip_limit"] == 2
    assert described["skip_translation"] == 0.05
    assert "skip_rotation" not in described
