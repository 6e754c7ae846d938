"""Which devices of which backend are present, and which of them measures."""

from __future__ import annotations

from slam.devices import opencl
from slam.devices.device import BACKENDS, Device, NoDeviceError

NAMES = {"opencl": "OpenCL", "webgpu": "WebGPU"}
INSTALL = {
    "opencl": (
        "install a driver for the GPU, or PoCL for the CPU "
        "(pip install pocl-binary-distribution on Linux x86-64, the package pocl-opencl-icd on Debian)"
    ),
    "webgpu": (
        "install the driver of the GPU with Vulkan, Metal or Direct3D 12, and pip install 'frontrunner[webgpu]' "
        "(a CPU takes Debian's package mesa-vulkan-drivers)"
    ),
}


def list_devices(backend: str = "opencl") -> list[Device]:
    """The devices of BACKEND, best first. Raises ValueError for an unknown backend."""
    if backend not in BACKENDS:
        raise ValueError(f"backend {backend!r}: choose one of {', '.join(BACKENDS)}")
    if backend == "opencl":
        return opencl.list_devices()
    from slam.devices import webgpu  # an extra that not everyone has installed

    return webgpu.list_devices()


def choose_device(text: str | None = None, backend: str = "opencl") -> Device:
    """The best device of BACKEND, or the best one whose label contains TEXT (case does not matter).

    Raises NoDeviceError, naming what is present.
    """
    devices, name = list_devices(backend), NAMES[backend]
    if not devices:
        raise NoDeviceError(f"no {name} device here: {INSTALL[backend]}")
    if not text:
        return devices[0]
    for device in devices:
        if text.lower() in device.label.lower():
            return device
    present = "; ".join(device.label for device in devices)
    raise NoDeviceError(f"no {name} device matches {text!r}; present: {present}")
