"""Which devices of which backend are present, and which of them measures."""

from __future__ import annotations

import platform
from typing import TYPE_CHECKING, TypeAlias

from slam.configuration import ConfigurationError
from slam.devices import opencl, wasm
from slam.devices.build import DEFAULT, Build
from slam.devices.device import BACKENDS, Device, NoDeviceError
from slam.devices.layout import Layout

if TYPE_CHECKING:
    from slam.devices.webgpu import WebGPUSession

AnySession: TypeAlias = "opencl.Session | WebGPUSession | wasm.WebAssemblySession"

NAMES = {"opencl": "OpenCL", "webgpu": "WebGPU", "wasm": "WebAssembly"}
INSTALL = {
    "opencl": (
        "install the extra opencl (pip install '.[opencl]'), which brings PoCL for the CPU on Linux x86-64; "
        "elsewhere also a driver for the GPU, or PoCL (the package pocl-opencl-icd on Debian)"
    ),
    "webgpu": (
        "install a driver of the GPU for Vulkan, Metal or Direct3D 12 (for the CPU Debian's package "
        "mesa-vulkan-drivers), and the extra webgpu (pip install '.[webgpu]')"
    ),
    "wasm": "install the extra wasm (pip install '.[wasm]'), which needs no driver",
}


def list_devices(backend: str = "opencl") -> list[Device]:
    """The devices of `backend`, best first; none without its package. Raises ValueError for an unknown
    backend.
    """
    if backend not in BACKENDS:
        raise ValueError(f"backend {backend!r}: choose one of {', '.join(BACKENDS)}")
    if backend == "opencl":
        return opencl.list_devices()
    if backend == "wasm":
        return wasm.list_devices()
    from slam.devices import webgpu

    return webgpu.list_devices()


def remedy(backend: str) -> str:
    """What to install so that `backend` has a device."""
    if backend == "wasm" and not wasm.has_wheel():
        return f"wasmtime has no wheel for {platform.machine()}: use OpenCL"
    return INSTALL[backend]


def choose_device(text: str | None = None, backend: str = "opencl") -> Device:
    """The best device of `backend`, or the best one whose label contains `text` (case does not matter).

    Raises NoDeviceError, naming what is present; its cause is the ImportError where pyopencl is missing.
    """
    devices, name = list_devices(backend), NAMES[backend]
    if not devices:
        refused = opencl.list_refusals() if backend == "opencl" else []
        reason = f" (the driver cannot compile for this processor: {'; '.join(refused)})" if refused else ""
        other = (
            "; or use WebAssembly (--backend wasm)" if backend == "opencl" and list_devices("wasm") else ""
        )
        missing = opencl.load_error() if backend == "opencl" else None
        raise NoDeviceError(f"no {name} device here{reason}: {remedy(backend)}{other}") from missing
    if not text:
        return devices[0]
    for device in devices:
        if text.lower() in device.label.lower():
            return device
    present = "; ".join(device.label for device in devices)
    raise NoDeviceError(f"no {name} device matches {text!r}; present: {present}")


def open_session(
    device: Device, layout: Layout | None = None, threads: int | None = None, build: Build = DEFAULT
) -> AnySession:
    """A session on `device`, with kernels laid out by `layout` (default: by the kind of device).

    WebAssembly executes them by `threads` (default: those of the device). `build` is for OpenCL: raises
    ConfigurationError for another backend, and where the device cannot do it.
    """
    if device.backend == "opencl":
        return opencl.Session(device, layout, build)
    if build != DEFAULT:
        raise ConfigurationError(
            f"{build}: {NAMES[device.backend]} has no build options: leave them out, or use OpenCL "
            "(--backend opencl)"
        )
    if device.backend == "wasm":
        return wasm.WebAssemblySession(device, layout, threads)
    from slam.devices import webgpu

    return webgpu.WebGPUSession(device, layout)
