"""Bands: how far devices that compute the same lie apart."""

from __future__ import annotations

import json
import sys
from dataclasses import replace

import pytest

from slam.__main__ import main
from slam.datasets import open_sequence
from slam.devices import wasm
from slam.devices.device import NoDeviceError
from slam.kfusion.configuration import Configuration
from slam.references import bands
from tests.slam.tiny import FRAMES, write_tiny_pack

SMALL = Configuration(volume_resolution=64, compute_size_ratio=2).to_dict()


@pytest.mark.slow
def test_the_band_is_three_times_the_largest_deviation_and_at_least_two_millimetres(tmp_path):
    sequence = open_sequence(write_tiny_pack(tmp_path))
    reference = bands.reference("kfusion", SMALL, sequence, 2)

    def band(*deviations: float) -> float:
        return replace(reference, deviations={("a", str(n)): d for n, d in enumerate(deviations)}).band

    assert band(0.001, 0.004) == 0.012
    assert band(0.0001, 0.0002) == 0.002
    assert band() == 0.002


@pytest.mark.slow
@pytest.mark.parametrize(("system", "configuration"), [("kfusion", SMALL), ("elasticfusion", {})])
def test_a_reference_compares_every_device_in_every_layout(tmp_path, system, configuration):
    sequence = open_sequence(write_tiny_pack(tmp_path, colour=True))
    reference = bands.reference(system, configuration, sequence)
    variants = len(list(bands.variants(system)))

    assert reference.trajectory.shape == (FRAMES, 3)
    assert len(reference.variants) == variants >= bands.LEAST_VARIANTS
    assert len(reference.deviations) == variants * (variants - 1) // 2
    assert 0 <= reference.largest_deviation < 0.05


@pytest.mark.slow
def test_without_opencl_webassembly_gives_the_reference(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyopencl", None)
    monkeypatch.setattr(
        bands, "list_devices", lambda backend="opencl": wasm.list_devices() * (backend == "wasm")
    )
    sequence = open_sequence(write_tiny_pack(tmp_path))
    reference = bands.reference("kfusion", SMALL, sequence, 6)
    assert [name.split(", ")[1:] for name in reference.variants] == [
        ["WebAssembly", "threads: 1"], ["WebAssembly", "threads: 2"], ["WebAssembly", "threads: 4"],
    ]  # fmt: skip
    assert reference.report.device["backend"] == "wasm"
    assert reference.largest_deviation == 0  # of one module: threads change no bit

    monkeypatch.setitem(sys.modules, "wasmtime", None)
    with pytest.raises(NoDeviceError, match="no OpenCL device here: install the extra opencl"):
        bands.reference("kfusion", SMALL, sequence, 6)


@pytest.mark.slow
def test_the_command_writes_trajectory_and_band(tmp_path, capsys):
    out = tmp_path / "out.json"
    settings = [f"--set={name}={value}" for name, value in SMALL.items()]
    arguments = ["reference", "--sequence", str(write_tiny_pack(tmp_path)), *settings]

    assert main([*arguments, "--frames", "6", "--json", str(out)]) == 0

    document = json.loads(out.read_text())
    assert len(document["reference"]["trajectory"]) == len(document["report"]["frames"]) == 6
    assert document["reference"]["band"] >= bands.LEAST_BAND
    assert "largest deviation" in capsys.readouterr().out
    assert main([*arguments, "--frames", "99", "--json", str(out)]) == 2
    assert "frames=99: give 1 to 12" in capsys.readouterr().err


@pytest.mark.slow
def test_one_that_leaves_out_frames_runs_again_with_changed_depth(tmp_path):
    sequence = open_sequence(write_tiny_pack(tmp_path))
    adapting = SMALL | {"integration_rate": 1, "skip_limit": 2, "skip_translation": 1.0, "skip_rotation": 1.0}

    reference = bands.reference("kfusion", adapting, sequence)

    variants = len(reference.variants)
    changed = [pair for pair in reference.deviations if "changed depth" in pair[1]]
    assert len(reference.deviations) == variants * (variants - 1) // 2 + len(changed)
    assert {first for first, _ in changed} == {reference.variants[0]}
    assert len(changed) == len(bands.PERTURBATIONS)
    assert reference.skipped == sum(frame.skipped for frame in reference.report.frames[10:]) / (FRAMES - 10)
    assert replace(reference, skips=False).skipped is None
