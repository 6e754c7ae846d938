"""Bands: how far devices that compute the same lie apart."""

from __future__ import annotations

import json

import numpy as np
import pytest

from slam.__main__ import main
from slam.configuration import ConfigurationError
from slam.datasets import open_sequence
from slam.kfusion.configuration import Configuration
from slam.references import bands
from tests.slam.tiny import FRAMES, write_tiny_pack

SMALL = Configuration(volume_resolution=64, compute_size_ratio=2).to_dict()


def test_the_band_is_three_times_the_largest_deviation_and_at_least_two_millimetres():
    def band(*deviations: float) -> float:
        return bands.Reference(np.zeros((1, 3)), {("a", str(n)): d for n, d in enumerate(deviations)}).band

    assert band(0.001, 0.004) == 0.012
    assert band(0.0001, 0.0002) == 0.002


def test_a_reference_compares_every_device_in_every_layout(tmp_path):
    sequence = open_sequence(write_tiny_pack(tmp_path))
    found = bands.reference(SMALL, sequence, FRAMES)
    variants = len(list(bands.variants()))

    assert found.trajectory.shape == (FRAMES, 3)
    assert len(found.deviations) == variants * (variants - 1) // 2
    assert 0 <= max(found.deviations.values()) < 0.05


def test_the_command_adds_trajectory_and_band(tmp_path, capsys):
    front = {"protocol": {"frames": 6}, "configurations": [{"name": "default", "parameters": SMALL}]}
    (tmp_path / "front.json").write_text(json.dumps(front))
    out = tmp_path / "out.json"
    arguments = [
        "reference",
        "--front",
        str(tmp_path / "front.json"),
        "--sequence",
        str(write_tiny_pack(tmp_path)),
    ]

    assert main([*arguments, "--out", str(out)]) == 0
    [configuration] = json.loads(out.read_text())["configurations"]
    assert len(configuration["trajectory"]) == 6
    assert configuration["band"] >= bands.LEAST_BAND
    assert "default: largest deviation" in capsys.readouterr().out
    assert main([*arguments, "--frames", "99", "--out", str(out)]) == 2
    assert "--frames 99: give 1 to 12" in capsys.readouterr().err


@pytest.mark.parametrize("text", ["{", "{}", '{"configurations": [{"name": "default"}]}'])
def test_what_is_not_a_front_is_named(tmp_path, text):
    (tmp_path / "front.json").write_text(text)
    with pytest.raises(ConfigurationError, match=r"front\.json is not a front"):
        bands.read_front(tmp_path / "front.json")
