"""Which devices of which backend are present, and which of them measures."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

from slam.devices import opencl
from slam.devices.device import BACKENDS, Device, NoDeviceError
from slam.devices.layout import Layout

if TYPE_CHECKING:
    from slam.devices.wasm import WebAssemblySession
    from slam.devices.webgpu import WebGPUSession

AnySession: TypeAlias = "opencl.Session | WebGPUSession | WebAssemblySession"

NAMES = {"opencl": "OpenCL", "webgpu": "WebGPU", "wasm": "WebAssembly"}
INSTALL = {
    "opencl": (
        "install a driver for the GPU, or PoCL for the CPU "
        "(pip install pocl-binary-distribution on Linux x86-64, the package pocl-opencl-icd on Debian)"
    ),
    "webgpu": (
        "install a driver of the GPU for Vulkan, Metal or Direct3D 12 (for the CPU Debian's package "
        "mesa-vulkan-drivers), and the extra webgpu (pip install '.[webgpu]')"
    ),
    "wasm": "install the extra wasm (pip install '.[wasm]'): it needs no driver",
}


def list_devices(backend: str = "opencl") -> list[Device]:
    """The devices of `backend`, best first. Raises ValueError for an unknown backend."""
    if backend not in BACKENDS:
        raise ValueError(f"backend {backend!r}: choose one of {', '.join(BACKENDS)}")
    if backend == "opencl":
        return opencl.list_devices()
    from slam.devices import wasm, webgpu  # what they import not everyone has installed

    return wasm.list_devices() if backend == "wasm" else webgpu.list_devices()


def choose_device(text: str | None = None, backend: str = "opencl") -> Device:
    """The best device of `backend`, or the best one whose label contains `text` (case does not matter).

    Raises NoDeviceError, naming what is present.
    """
    devices, name = list_devices(backend), NAMES[backend]
    if not devices:
        refused = opencl.list_refusals() if backend == "opencl" else []
        reason = f" (the driver cannot compile for this processor: {'; '.join(refused)})" if refused else ""
        raise NoDeviceError(f"no {name} device here{reason}: {INSTALL[backend]}")
    if not text:
        return devices[0]
    for device in devices:
        if text.lower() in device.label.lower():
            return device
    present = "; ".join(device.label for device in devices)
    raise NoDeviceError(f"no {name} device matches {text!r}; present: {present}")


def open_session(device: Device, layout: Layout | None = None) -> AnySession:
    """A session on `device`, with kernels laid out by `layout` (default: by the kind of device)."""
    if device.backend == "opencl":
        return opencl.Session(device, layout)
    from slam.devices import wasm, webgpu

    if device.backend == "wasm":
        return wasm.WebAssemblySession(device, layout)
    return webgpu.WebGPUSession(device, layout)
