"""WebAssembly's device, sessions and threads; the kernels are compared on it in tests/slam/conformance."""

from __future__ import annotations

import dataclasses
import gc
import platform
import subprocess
import sys
import threading

import numpy as np
import pytest

from slam.devices import wasm
from slam.devices.choice import choose_device, open_session
from slam.devices.device import DeviceError, DeviceMemoryError, NoDeviceError
from slam.devices.layout import Layout
from slam.kfusion.configuration import Configuration
from slam.kfusion.pipeline import FOLDERS, KFusion
from slam.kfusion.plan import plan
from slam.plans.wasm import MODULE, WebAssemblyExecution
from tests.slam.kfusion.test_pipeline import DEPTH, SCENE

SMALL = Configuration(volume_resolution=32)


@pytest.fixture
def session() -> wasm.WebAssemblySession:
    return wasm.WebAssemblySession(choose_device(backend="wasm"), threads=2)


def test_importing_the_module_does_not_import_wasmtime():
    code = "import sys, slam.devices.wasm, slam.plans.wasm; sys.exit('wasmtime' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_there_is_no_device_without_wasmtime_and_the_error_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "wasmtime", None)
    assert wasm.list_devices() == []
    monkeypatch.setattr(platform, "machine", lambda: "aarch64")
    with pytest.raises(NoDeviceError, match=r"no WebAssembly device here: .*pip install '\.\[wasm\]'"):
        choose_device(backend="wasm")
    monkeypatch.setattr(platform, "machine", lambda: "armv7l")
    with pytest.raises(NoDeviceError, match="wasmtime has no wheel for armv7l: use OpenCL"):
        choose_device(backend="wasm")


def test_the_device_is_the_processor():
    [device] = wasm.list_devices()
    assert (device.backend, device.kind, device.platform) == ("wasm", "cpu", "wasmtime")
    assert 1 <= device.compute_units <= wasm.MOST_THREADS
    assert open_session(device).threads == device.threads == device.compute_units


def test_kernels_are_laid_out_by_rows(session):
    assert session.layout == Layout("rows")
    with pytest.raises(ValueError, match="kernel layout"):
        wasm.WebAssemblySession(session.device, Layout("pixels"))


def test_a_plan_that_needs_more_than_the_device_allows_is_refused(session):
    small = dataclasses.replace(session.device, max_allocation=2**20)
    with pytest.raises(DeviceMemoryError, match="allows at most 1 MiB"):
        KFusion(SMALL, SCENE, wasm.WebAssemblySession(small))


def test_a_module_that_does_not_compile_is_a_device_error(session, tmp_path):
    (tmp_path / MODULE).write_bytes(b"no module")
    with pytest.raises(DeviceError, match=f"wasmtime refused {MODULE}"):
        WebAssemblyExecution(plan(SMALL, SCENE, session.layout), session, (tmp_path,))


def test_threads_change_no_bit_of_the_result_and_end_with_the_system(session):
    gc.collect()  # systems of other tests, with their threads
    before = threading.active_count()
    states = []
    for threads in (1, 2, 5):
        opened = open_session(session.device, threads=threads)
        system = KFusion(SMALL, SCENE, opened)
        assert threading.active_count() == before + threads - 1
        states.append([system.process(image).pose for image in DEPTH])
        del system
        gc.collect()
        assert threading.active_count() == before
    np.testing.assert_array_equal(states[0], states[1])
    np.testing.assert_array_equal(states[0], states[2])


def test_planes_and_parts_of_a_buffer_are_read_as_they_were_written(session):
    execution = WebAssemblyExecution(plan(SMALL, SCENE, session.layout), session, FOLDERS)
    buffer = next(each for each in execution.plan.buffers if each.planes > 1)
    values = np.arange(buffer.planes * buffer.count).astype(buffer.numpy_type).reshape(buffer.planes, -1)
    execution.write(buffer.name, values)
    np.testing.assert_array_equal(execution.read(buffer.name), values)
    np.testing.assert_array_equal(execution.read(buffer.name, 1, 2), values[:, 1:3])
