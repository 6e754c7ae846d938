"""Where kernels run in the tests: every device of every backend, in every layout that it takes."""

from __future__ import annotations

from typing import Any

import pytest

from slam.devices.choice import AnySession, choose_device, list_devices, open_session
from slam.devices.layout import KINDS, Layout
from slam.devices.wasm import WebAssemblySession

THREADS = (1, 3)  # of WebAssembly
NO_WEBGPU = (
    "no WebGPU adapter: install wgpu (the extra webgpu) and a driver; Debian's mesa-vulkan-drivers has one "
    "for CPUs"
)


def _name(backend: str, *parts: str) -> str:
    return "-".join((backend, *parts)).replace(" ", "-")


def _places() -> list[Any]:
    """Pytest's parameters: a device and its layout, None where there is no WebGPU device, and WebAssembly's
    threads."""
    opencl = [
        pytest.param((device, Layout(kind)), id=_name("opencl", device.kind, device.driver, kind))
        for device in list_devices("opencl")
        for kind in KINDS
    ]
    webgpu = [
        pytest.param((device, None), id=_name("webgpu", device.kind, device.name))
        for device in list_devices("webgpu")
    ]
    wasm = [pytest.param(threads, id=_name("wasm", str(threads))) for threads in THREADS]
    return [*opencl, *(webgpu or [pytest.param(None, id="webgpu-none")]), *wasm]


PLACES = _places()


@pytest.fixture(scope="session", params=PLACES)
def session(request: pytest.FixtureRequest) -> AnySession:
    """Every device of every backend, with each layout of its kernels; a skip where there is no WebGPU.

    WebAssembly needs no driver: it is never skipped.
    """
    if request.param is None:
        pytest.skip(NO_WEBGPU)
    if isinstance(request.param, int):
        return WebAssemblySession(choose_device(backend="wasm"), threads=request.param)
    return open_session(*request.param)
