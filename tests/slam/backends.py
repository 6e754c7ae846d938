"""Where kernels run in the tests: every device of every backend, in every layout and with every build option
that it takes."""

from __future__ import annotations

from typing import Any

import pytest

from slam.devices.build import Build
from slam.devices.choice import AnySession, choose_device, list_devices, open_session
from slam.devices.layout import KINDS, Layout
from slam.devices.wasm import WebAssemblySession

THREADS = (1, 3)  # of WebAssembly
# Each option of a build, without unsafe_math where that implies it.
BUILDS = {
    "mad-and-no-signed-zeros": Build(build_unsafe_math=False, build_no_signed_zeros=True),
    "groups-32x2-of-one-thread": Build(build_group_width=32, build_group_height=2, build_threads=1),
}
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
    return [*opencl, *built("opencl"), *(webgpu or [pytest.param(None, id="webgpu-none")]), *wasm]


def built(*prefix: str) -> list[Any]:
    """Pytest's parameters: the first OpenCL device, its default layout, no number of threads, and a build."""
    return [
        pytest.param(
            (device, None, None, build), id=_name(*prefix, device.driver, name), marks=pytest.mark.slow
        )
        for device in list_devices("opencl")[:1]
        for name, build in BUILDS.items()
    ]


PLACES = _places()


@pytest.fixture(scope="session", params=PLACES)
def session(request: pytest.FixtureRequest) -> AnySession:
    """Every device of every backend, with each layout of its kernels and each build option.

    Where there is no WebGPU, its tests are skipped.

    WebAssembly needs no driver: it is never skipped.
    """
    if request.param is None:
        pytest.skip(NO_WEBGPU)
    if isinstance(request.param, int):
        return WebAssemblySession(choose_device(backend="wasm"), threads=request.param)
    return open_session(*request.param)
