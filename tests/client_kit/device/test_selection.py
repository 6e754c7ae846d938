"""Which device measures: the fastest that works here, over the backend that drives it best."""

import os
import platform
import sys
from dataclasses import replace
from itertools import islice
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from client_kit.device import doctor, selection
from client_kit.device.selection import backends_for, choose, present
from client_kit.errors import CannotMeasureError, UsageError
from client_kit.home import Home
from slam.devices import choice, opencl

OPENCL_GPU, OPENCL_CPU = ("opencl", "gpu"), ("opencl", "cpu")
WEBGPU_GPU, WEBGPU_CPU = ("webgpu", "gpu"), ("webgpu", "cpu")
WASM_CPU = ("wasm", "cpu")


class Machine:
    """Lists made-up devices, and remembers for which backends it was asked."""

    def __init__(self, *devices: tuple[str, str]) -> None:
        self.asked: list[str] = []
        self._devices = devices

    def list_devices(self, backend: str = "opencl") -> list[Any]:
        self.asked.append(backend)
        kinds = [kind for at, kind in self._devices if at == backend]
        labels = {kind: f"a {kind.upper()} ({backend})" for kind in kinds}
        return [
            SimpleNamespace(backend=backend, kind=kind, label=labels[kind], global_memory=0) for kind in kinds
        ]


def machine(monkeypatch: pytest.MonkeyPatch, *devices: tuple[str, str]) -> Machine:
    made = Machine(*devices)
    for module in (selection, choice):
        monkeypatch.setattr(module, "list_devices", made.list_devices)
    monkeypatch.setattr(selection, "TRIAL", "")  # every device opens
    return made


def what(device: Any) -> tuple[str, str]:
    return device.backend, device.kind


@pytest.mark.parametrize(
    ("devices", "best"),
    [
        ((WEBGPU_CPU, WEBGPU_GPU, OPENCL_CPU, OPENCL_GPU), OPENCL_GPU),
        ((WEBGPU_CPU, WEBGPU_GPU, OPENCL_CPU), WEBGPU_GPU),
        ((WEBGPU_CPU, OPENCL_CPU), OPENCL_CPU),
        ((WEBGPU_CPU,), WEBGPU_CPU),
        ((WASM_CPU, OPENCL_CPU), OPENCL_CPU),
        ((WASM_CPU, WEBGPU_GPU), WEBGPU_GPU),
        ((WASM_CPU,), WASM_CPU),
    ],
)
def test_the_fastest_kind_of_device_is_chosen(
    devices: tuple[tuple[str, str], ...], best: tuple[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    machine(monkeypatch, *devices)

    assert what(choose()) == best
    assert what(present()[0]) == best
    assert len(present()) == len(devices)


def test_no_other_driver_is_loaded_where_opencl_drives_a_gpu(monkeypatch: pytest.MonkeyPatch) -> None:
    made = machine(monkeypatch, OPENCL_GPU, WEBGPU_GPU)

    choose()

    assert made.asked == ["opencl"]


@pytest.mark.slow
@pytest.mark.parametrize(
    "trial", ["raise SystemExit(1)", "import os; os.abort()", "import signal; signal.pause()"]
)
def test_a_webgpu_device_that_does_not_open_leaves_another_one(
    trial: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    machine(monkeypatch, OPENCL_CPU, WEBGPU_GPU)
    monkeypatch.setattr(selection, "TRIAL", trial)
    monkeypatch.setattr(selection, "TRIAL_SECONDS", 2)

    assert what(choose()) == OPENCL_CPU
    assert what(choose("GPU")) == WEBGPU_GPU  # nothing else matches: measuring will say why it does not open
    assert what(choose(backends=("webgpu",))) == WEBGPU_GPU


def test_the_doctor_marks_the_device_that_is_used(monkeypatch: pytest.MonkeyPatch, home: Home) -> None:
    machine(monkeypatch, OPENCL_CPU, WEBGPU_GPU)

    def lines() -> list[str]:
        return [line for line in islice(doctor.examine(home), 4) if " device: " in line]

    used = ", used unless --device or --backend names another"
    assert lines() == [f"WebGPU device: a GPU (webgpu){used}", "OpenCL device: a CPU (opencl)"]
    monkeypatch.setattr(selection, "TRIAL", "raise SystemExit(1)")
    assert lines() == ["WebGPU device: a GPU (webgpu)", f"OpenCL device: a CPU (opencl){used}"]


@pytest.mark.slow
def test_a_device_is_tried_by_opening_it_as_a_measurement_does() -> None:
    devices = selection.list_devices("webgpu")
    if not devices:
        pytest.skip("no device over webgpu here")

    assert selection._opens(devices[0])
    assert not selection._opens(replace(devices[0], name="abacus"))


def test_a_text_is_looked_for_in_every_backend_or_in_the_one_that_is_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    machine(monkeypatch, OPENCL_CPU, WEBGPU_CPU, WEBGPU_GPU)

    assert what(choose("gpu (")) == WEBGPU_GPU
    assert what(choose("CPU")) == OPENCL_CPU
    assert what(choose("cpu", ("webgpu",))) == WEBGPU_CPU
    with pytest.raises(CannotMeasureError, match=r"no OpenCL device matches 'gpu \('; present: a CPU"):
        choose("gpu (", ("opencl",))
    with pytest.raises(CannotMeasureError, match="no OpenCL, WebGPU or WebAssembly device matches 'Mali'"):
        choose("Mali")


def test_where_nothing_is_here_it_says_what_would_help(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    machine(monkeypatch)

    monkeypatch.setattr(platform, "machine", lambda: "x86_64")
    install = r"install the extra opencl .*; or install the extra wasm \(.*\), which needs no driver"
    with pytest.raises(CannotMeasureError, match=rf"no OpenCL device here.*: {install}"):
        choose(root=tmp_path)
    with pytest.raises(CannotMeasureError, match=r"no OpenCL device here: .* on Debian\)$"):
        choose(backends=("opencl",), root=tmp_path)
    with pytest.raises(CannotMeasureError, match=r"no WebGPU device here: .*pip install '\.\[webgpu\]'"):
        choose(backends=("webgpu",), root=tmp_path)
    monkeypatch.setattr(platform, "machine", lambda: "armv7l")
    with pytest.raises(CannotMeasureError, match="wasmtime has no wheel for armv7l: use OpenCL"):
        choose(root=tmp_path)


def test_a_package_that_is_missing_leaves_the_other_backend(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyopencl", None)
    machine(monkeypatch, WASM_CPU)

    assert opencl.list_devices() == opencl.list_refusals() == []
    assert what(choose()) == WASM_CPU
    with pytest.raises(CannotMeasureError, match="pyopencl is not installed here: pip install pyopencl"):
        choose(backends=("opencl",))


def test_an_application_is_measured_over_the_backends_that_it_runs_on() -> None:
    assert backends_for("kfusion") == ("opencl", "webgpu", "wasm")
    assert backends_for("kfusion", "webgpu") == ("webgpu",)
    assert backends_for("elasticfusion") == ("opencl",)
    with pytest.raises(UsageError, match="elasticfusion runs on opencl only, not on webgpu"):
        backends_for("elasticfusion", "webgpu")


def test_what_graphics_drivers_complain_of_is_not_shown(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def noisy(backend: str = "opencl") -> list[Any]:
        os.write(2, b"no windowing system\n")
        return []

    monkeypatch.setattr(selection, "list_devices", noisy)

    assert present(("webgpu",)) == []
    os.write(2, b"afterwards\n")

    assert capfd.readouterr().err == "afterwards\n"
