"""Devices, programs and memory, on what is really present."""

from __future__ import annotations

import os
import subprocess
import sys
import types
from pathlib import Path

import numpy as np
import pytest

from slam.camera import Camera
from slam.devices import opencl
from slam.devices.choice import choose_device, list_devices
from slam.devices.device import DeviceError, DeviceMemoryError, NoDeviceError
from slam.devices.opencl import Session, _fitting
from slam.kfusion.configuration import Configuration
from slam.kfusion.pipeline import KFusion
from slam.system import Scene
from tests.slam.tiny import write_tiny_pack

ROOT = Path(__file__).parents[3]
DOUBLE = """
kernel void twice(global const float *in, global float *out, int offset, float factor)
{
    const int i = get_global_id(0);
    out[i] = factor * in[i] + offset;
}
"""


def test_the_host_reads_a_constant_from_the_kernels(tmp_path):
    source = tmp_path / "shared.cl"
    source.write_text("#define ROWS 16 // of a band\n#define REACH 0.5f\n")

    assert opencl.defined(source, "ROWS") == 16
    with pytest.raises(ValueError, match=r"shared\.cl defines no whole number REACH"):
        opencl.defined(source, "REACH")


def test_devices_say_what_they_are():
    devices = list_devices()
    assert devices
    for device in devices:
        assert set(device.describe()) == {"platform", "name", "driver", "backend"}
        assert device.max_allocation > 0
        assert device.kind in {"gpu", "cpu", "accelerator", "other"}


def test_a_device_is_chosen_by_any_part_of_its_description_in_any_case():
    for device in list_devices():
        assert choose_device(device.driver.upper()).driver == device.driver


def test_an_unknown_device_is_answered_with_those_present():
    with pytest.raises(NoDeviceError, match=r"no OpenCL device matches 'abacus'; present: .+"):
        choose_device("abacus")


def test_a_machine_without_opencl_gets_an_error_with_what_to_install(tmp_path):
    code = "from slam.devices.choice import choose_device\nchoose_device()"
    environment = os.environ | {"OCL_ICD_VENDORS": str(tmp_path / "none")}
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment)
    last = ended.stderr.strip().splitlines()[-1]
    assert "NoDeviceError: no OpenCL device here: install" in last


def test_a_kernel_keeps_its_arguments_from_launch_to_launch(tmp_path):
    source = tmp_path / "twice.cl"
    source.write_text(DOUBLE)
    for device in list_devices():
        session = Session(device)
        given, got = np.arange(5, dtype=np.float32), np.zeros(5, np.float32)
        buffer = session.buffer(20)
        # The output buffer has no other name than the kernel's argument.
        kernel = session.kernel(source, "twice", (5,), buffer, result := session.buffer(20), 3, 2.0)
        for shift in (0, 10):
            session.upload(buffer, given + np.float32(shift))
            kernel()
            session.download(result, got)
            np.testing.assert_array_equal(got, 2 * (given + shift) + 3)


def test_memory_beyond_the_device_is_refused_before_it_is_asked_for():
    device = choose_device()
    with pytest.raises(DeviceMemoryError, match=r"a map needs one buffer of .* MiB, .* allows at most"):
        Session(device).buffer(device.max_allocation + 1, "a map")


def test_a_program_builds_in_a_folder_whose_name_has_a_space(tmp_path):
    """Drivers split an include path at its spaces, so they get one text."""
    folder = tmp_path / "my phone"
    folder.mkdir()
    (folder / "factor.h").write_text("#define FACTOR 2.0f\n")
    (folder / "scaled.cl").write_text(
        '#include "factor.h"\n#include "arithmetic.h"\n'
        "kernel void scaled(global float *x) { x[get_global_id(0)] *= larger(FACTOR, 1.0f); }\n"
    )
    session = Session(choose_device())
    values = np.arange(4, dtype=np.float32)
    buffer = session.buffer(values.nbytes)
    session.upload(buffer, values)
    session.kernel(folder / "scaled.cl", "scaled", (4,), buffer)()
    session.download(buffer, values)

    np.testing.assert_array_equal(values, [0, 2, 4, 6])


def test_what_a_driver_refuses_is_one_sentence(tmp_path):
    source = tmp_path / "broken.cl"
    source.write_text("kernel void broken(global float *x) { x[0] = y; }\n")
    with pytest.raises(DeviceError, match=r"refused compiling broken\.cl: .+") as refused:
        Session(choose_device()).kernel(source, "broken", (1,))
    assert "\n" not in str(refused.value)


@pytest.mark.slow
def test_a_device_with_small_work_groups_measures_all_the_same(tmp_path):
    """Groups of the layout by pixels have 128 work-items; this device allows half of that."""
    environment = os.environ | {"POCL_MAX_WORK_GROUP_SIZE": "64", "FRONTRUNNER_KERNELS": "pixels"}
    sequence = write_tiny_pack(tmp_path)
    ended = subprocess.run(
        [sys.executable, "-m", "slam", "run", "--sequence", str(sequence), "--set", "volume_resolution=64"],
        capture_output=True, text=True, env=environment, cwd=ROOT, check=False,
    )  # fmt: skip
    assert ended.returncode == 0, ended.stderr
    assert "lost 0" in ended.stdout


@pytest.mark.parametrize("span", [None, (0, 0)], ids=["unknown", "too long"])
def test_without_the_device_s_clock_a_run_has_no_stages(monkeypatch, span):
    """Some drivers know no times, and some clocks are wrong: the frame is measured all the same."""
    monkeypatch.setattr(Session, "span", lambda *_: None if span is None else (1, 10**12))
    scene = Scene(Camera(60.0, 60.0, 31.5, 23.5, 64, 48), 4.0, (0.5, 0.5, 0.1))
    system = KFusion(Configuration(volume_resolution=32), scene, Session(choose_device()))
    frames = [system.process(np.full((48, 64), 1500, np.uint16)) for _ in range(3)]

    assert system.stage_clock == "none"
    assert [frame.seconds for frame in frames] == [{}, {}, {}]
    assert all(frame.computation > 0 for frame in frames)


def test_a_driver_that_allows_no_work_items_still_gets_an_answer():
    assert _fitting((16, 8), 0) == (1, 1)
    assert _fitting((16, 8), 64) == (8, 8)
    assert _fitting((1, 1), 1) == (1, 1)


def test_a_driver_that_cannot_compile_is_not_chosen_and_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(opencl, "_refusals", {})
    monkeypatch.setattr(opencl, "_compile_nothing", lambda _: "unknown target CPU 'generic'")
    processors = [device for device in opencl._present() if device.kind == "cpu"]
    assert not any(device.kind == "cpu" for device in list_devices())
    refusals = opencl.list_refusals()
    assert len(refusals) == len(processors) > 0
    assert all(line.endswith("unknown target CPU 'generic'") for line in refusals)
    if not list_devices():
        with pytest.raises(NoDeviceError, match="cannot compile for this processor"):
            choose_device()


def test_a_folder_that_is_all_that_is_left_of_pyopencl_is_no_pyopencl(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyopencl", types.ModuleType("pyopencl"))

    assert isinstance(opencl.load_error(), ImportError)
    assert opencl.list_devices() == opencl.list_refusals() == []
