"""WebGPU devices, sessions and the executor: limits, errors, and memory of odd sizes."""

from __future__ import annotations

import dataclasses
import subprocess
import sys

import numpy as np
import pytest

from slam.devices import webgpu
from slam.devices.choice import list_devices
from slam.devices.device import DeviceError, DeviceMemoryError
from slam.devices.layout import Layout
from slam.kfusion.configuration import Configuration
from slam.kfusion.declarations import MEMBERS
from slam.kfusion.pipeline import FOLDERS, KFusion
from slam.kfusion.plan import plan
from slam.plans.plan import STATE, Buffer, Dispatch, Frames, Kernel, Parameter, Plan
from slam.plans.webgpu import WebGPUExecution
from tests.slam.backends import NO_WEBGPU
from tests.slam.kfusion.test_pipeline import DEPTH, SCENE

ADD = """@compute @workgroup_size(1)
fn add(@builtin(global_invocation_id) id: vec3u) {
    values[id.x] += u32(f32(parameters.amount) + parameters.vector.w);
}
"""


@pytest.fixture(scope="module")
def session() -> webgpu.WebGPUSession:
    devices = list_devices("webgpu")
    if not devices:
        pytest.skip(NO_WEBGPU)
    return webgpu.WebGPUSession(devices[0])


def plan_of(*buffers: Buffer, kernels=(), dispatches=()) -> Plan:
    return Plan(
        "test", "pixels", {}, {}, {}, MEMBERS, {"inliers": (3.0,)}, (Buffer("state", STATE, 1), *buffers),
        tuple(kernels), tuple(dispatches), input="image",
    )  # fmt: skip


def test_importing_the_module_does_not_import_wgpu():
    code = "import sys, slam.devices.webgpu, slam.plans.webgpu; sys.exit('wgpu' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_there_is_no_device_without_wgpu(monkeypatch):
    monkeypatch.setitem(sys.modules, "wgpu", None)
    assert webgpu.list_devices() == []


def test_a_device_says_what_it_is(session):
    device = session.device
    assert device.backend == "webgpu"
    assert device.kind in ("gpu", "cpu", "other")
    assert device.platform in ("Vulkan", "Metal", "D3D12")
    assert device.name in device.label
    assert device.max_allocation == 128 * 2**20


def test_a_session_has_the_default_limits_and_no_optional_feature(session):
    granted = session._device.limits
    assert {name: granted[name] for name in webgpu.LIMITS} == dict(webgpu.LIMITS)
    assert not {"shader-f16", "timestamp-query", "subgroup"} & set(session._device.features)


def test_kernels_are_laid_out_by_pixels(session):
    assert session.layout == Layout("pixels", (16, 8))
    with pytest.raises(ValueError, match="kernel layout"):
        webgpu.WebGPUSession(session.device, Layout("rows"))


def test_a_volume_above_the_default_limit_names_what_fits(session):
    with pytest.raises(DeviceMemoryError, match=r"volume_resolution=512 .* 512 MiB.*choose 256 or less"):
        KFusion(Configuration(volume_resolution=512), SCENE, session)


def test_memory_that_the_driver_refuses_is_a_device_error(session):
    generous = dataclasses.replace(session.device, max_allocation=2**40)
    with pytest.raises(DeviceError, match="a map"):
        webgpu.WebGPUSession(generous).buffer(2**32, "a map")


def test_a_kernel_that_does_not_compile_says_where(session):
    with pytest.raises(DeviceError, match=r"the kernel wrong.*unknwon"):
        session.pipeline("@compute @workgroup_size(1) fn wrong() { let x = unknwon; }", "wrong", ())


def test_a_kernel_is_compiled_once_for_each_text(session):
    text = "@compute @workgroup_size(1) fn nothing() {}"
    assert session.pipeline(text, "nothing", ()) is session.pipeline(text, "nothing", ())
    assert session.pipeline(text, "nothing", ()) is not session.pipeline(text + "\n", "nothing", ())


def test_memory_that_does_not_start_at_zero_is_refused(session):
    with pytest.raises(DeviceError, match="buffers words"):
        WebGPUExecution(plan_of(Buffer("words", "u32", 4, fill=1)), session, ())


@pytest.mark.parametrize(("kind", "count"), [("u16", 7), ("u8", 5), ("f32", 3)])
def test_memory_of_odd_sizes_is_written_and_read(session, kind, count):
    execution = WebGPUExecution(plan_of(Buffer("values", kind, count, planes=2)), session, ())
    kinds = {"u16": np.uint16, "u8": np.uint8, "f32": np.float32}
    values = np.arange(2 * count, dtype=kinds[kind]).reshape(2, count)
    execution.write("values", values)
    np.testing.assert_array_equal(execution.read("values"), values)
    np.testing.assert_array_equal(execution.read("values", 1, 2), values[:, 1:3])


def test_a_frame_without_launches_returns_the_state(session):
    execution = WebGPUExecution(plan_of(Buffer("image", "u16", 15)), session, ())
    outcome = execution.run(0, np.full((5, 3), 9, np.uint16))
    assert (outcome.state["inliers"], outcome.stages) == (3, {})
    assert outcome.computation > 0
    assert execution.stage_clock == "none"
    assert (execution.read("image") == 9).all()


def test_each_launch_has_its_own_parameters_and_frames(session, tmp_path):
    (tmp_path / "add.wgsl").write_text(ADD)
    kernel = Kernel("add", "none", (
        Parameter("amount", "i32"), Parameter("values", "u32", "write"), Parameter("vector", "vec4f"),
    ))  # fmt: skip
    always, once = (Frames(),), (Frames(first=1, last=1),)
    dispatches = [
        Dispatch("add", "test", (size,), (1,), {"amount": 1, "values": "values", "vector": vector}, frames)
        for size, vector, frames in ((3, (0.0, 0.0, 0.0, 10.0), always), (1, (0.0, 0.0, 0.0, 100.0), once))
    ]
    launched = plan_of(Buffer("values", "u32", 3), kernels=[kernel], dispatches=dispatches)
    execution = WebGPUExecution(launched, session, (tmp_path,))
    for number, expected in enumerate(([11, 11, 11], [123, 22, 22], [134, 33, 33])):
        execution.run(number)
        assert execution.read("values")[0].tolist() == expected


def test_a_lost_device_is_a_device_error():
    devices = list_devices("webgpu")
    if not devices:
        pytest.skip(NO_WEBGPU)
    session = webgpu.WebGPUSession(devices[0])
    small = plan(Configuration(volume_resolution=32), SCENE, session.layout)
    execution = WebGPUExecution(small, session, FOLDERS)
    execution.run(0, DEPTH[0])
    session._device.destroy()
    with pytest.raises(DeviceError, match="was lost"):
        execution.run(1, DEPTH[1])
