"""OpenCL devices, programs and kernels with their arguments bound once.

pyopencl is imported on first use: a process that lists OpenCL devices and then forks leaves its
children with a hanging OpenCL, so merely importing this module must touch nothing.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from slam.layout import Layout

if TYPE_CHECKING:
    import pyopencl as cl

# Not -cl-fast-relaxed-math: it lets the compiler assume that NaN does not exist, and bounds tests
# written `!(x >= 0 && x < width)` then let NaN through. Denormals, signed zeros and the order of
# float sums may go: reductions over an image row become vector code.
BUILD_OPTIONS = ("-cl-std=CL1.2", "-cl-mad-enable", "-cl-unsafe-math-optimizations", "-cl-denorms-are-zero")
SHARED = Path(__file__).parent / "dense" / "kernels"  # what the programs of every system may `#include`


class OpenCLError(RuntimeError):
    """Something that OpenCL cannot do here; the message says what would help."""


class NoDeviceError(OpenCLError):
    """No OpenCL device is present, or none whose name contains what was asked for."""


class DeviceMemoryError(OpenCLError):
    """The device allows less memory than a configuration needs."""


@dataclass(frozen=True)
class Device:
    """One OpenCL device. `kind` is "gpu", "cpu", "accelerator" or "other"; sizes in bytes."""

    platform: str
    version: str
    name: str
    driver: str
    kind: str
    compute_units: int
    max_allocation: int
    global_memory: int
    double_precision: bool
    handle: cl.Device

    @property
    def backend(self) -> str:
        return "opencl"

    @property
    def label(self) -> str:
        """What `--device` matches: name, platform, version and driver."""
        return f"{self.name} ({self.platform}, {self.version}, driver {self.driver})"

    def describe(self) -> dict[str, str]:
        return {"platform": self.platform, "name": self.name, "driver": self.driver, "backend": self.backend}


def list_devices() -> list[Device]:
    """All OpenCL devices, best first: GPUs, accelerators, then CPUs by the version of their runtime.

    Two installations of PoCL share one platform name; the newer one comes first.
    """
    import pyopencl as cl

    try:
        platforms = cl.get_platforms()
    except cl.LogicError:  # the loader found no platform at all
        return []
    devices = []
    for platform in platforms:
        try:
            devices += [_describe(platform, handle) for handle in platform.get_devices()]
        except (cl.LogicError, cl.RuntimeError):  # a platform without a usable device
            continue
    rank = {"gpu": 0, "accelerator": 1, "cpu": 2, "other": 3}
    return sorted(devices, key=lambda d: (rank[d.kind], [-part for part in _numbers(d.driver)]))


def choose_device(text: str | None = None) -> Device:
    """The best device, or the best one whose label contains `text` (case does not matter).

    Raises NoDeviceError, naming what is present.
    """
    devices = list_devices()
    if not devices:
        raise NoDeviceError(
            "no OpenCL device here: install a driver for the GPU, or PoCL for the CPU "
            "(pip install pocl-binary-distribution on Linux x86-64, the package pocl-opencl-icd on Debian)"
        )
    if not text:
        return devices[0]
    for device in devices:
        if text.lower() in device.label.lower():
            return device
    raise NoDeviceError(f"no OpenCL device matches {text!r}; present: " + "; ".join(d.label for d in devices))


def _argument(value: Any) -> Any:
    if isinstance(value, int):
        return np.int32(value)
    if isinstance(value, float):
        return np.float32(value)
    return value


def _numbers(version: str) -> list[int]:
    """Release numbers in a version string, padded: 3.1 sorts above 3.0-rc2."""
    found = [int(digits) for digits in re.findall(r"\d+", version.split("-")[0])]
    return [*found, 0, 0, 0, 0][:4]


def _describe(platform: cl.Platform, handle: cl.Device) -> Device:
    import pyopencl as cl

    kinds = {cl.device_type.GPU: "gpu", cl.device_type.CPU: "cpu", cl.device_type.ACCELERATOR: "accelerator"}
    bits = handle.type
    return Device(
        platform=platform.name.strip(),
        version=" ".join(platform.version.split()),
        name=handle.name.strip(),
        driver=handle.driver_version.strip(),
        kind=next((kind for bit, kind in kinds.items() if bits & bit), "other"),
        compute_units=handle.max_compute_units,
        max_allocation=handle.max_mem_alloc_size,
        global_memory=handle.global_mem_size,
        double_precision="cl_khr_fp64" in handle.extensions,
        handle=handle,
    )


class Session:
    """A context and an in-order queue on one device, with the programs built on it.

    `layout` (default: by the kind of device) says how kernels over images are laid out. Configurations
    reach kernels as arguments, never as macros: one build serves them all.
    """

    def __init__(self, device: Device, layout: Layout | None = None) -> None:
        import pyopencl as cl

        self.device = device
        self.layout = layout or Layout.for_device(device.kind)
        self.context = cl.Context([device.handle])
        self.queue = cl.CommandQueue(self.context)
        self._programs: dict[Path, cl.Program] = {}

    def program(self, source: Path) -> cl.Program:
        """The program of one `.cl` file, built on first use.

        It may `#include` files of its folder and of SHARED.
        """
        import pyopencl as cl

        if source not in self._programs:
            options = [*BUILD_OPTIONS, f"-I{source.parent}", f"-I{SHARED}"]
            if self.device.double_precision:
                options.append("-DDOUBLE_PRECISION")
            if self.layout.pixels:
                options.append("-DPIXELS")
            self._programs[source] = cl.Program(self.context, source.read_text()).build(options)
        return self._programs[source]

    def kernel(
        self,
        source: Path,
        name: str,
        size: tuple[int, ...],
        *arguments: Any,
        group: tuple[int, ...] | None = None,
    ) -> BoundKernel:
        """The kernel `name` of a file over `size` work-items, with its arguments set.

        `group` is the size of the work-groups, by default one work-item each: that leaves a kernel's own
        loops to the compiler. Python's int and float become OpenCL's 32-bit ones.
        """
        import pyopencl as cl

        kernel = cl.Kernel(self.program(source), name)
        kernel.set_args(*(_argument(value) for value in arguments))
        return BoundKernel(self.queue, kernel, size, group or (1,) * len(size), arguments)

    def image_kernel(self, source: Path, name: str, width: int, height: int, *arguments: Any) -> BoundKernel:
        """The kernel `name` of a file over an image, laid out as this session's `layout` says."""
        size, group = self.layout.over(width, height)
        return self.kernel(source, name, size, *arguments, group=group)

    def buffer(self, nbytes: int, what: str = "a buffer") -> cl.Buffer:
        """Device memory of `nbytes`. Raises DeviceMemoryError, naming `what` needs it and what is allowed."""
        import pyopencl as cl

        if nbytes > self.device.max_allocation:
            raise DeviceMemoryError(
                f"{what} needs one buffer of {nbytes / 2**20:.0f} MiB, {self.device.name!r} allows "
                f"at most {self.device.max_allocation / 2**20:.0f} MiB"
            )
        try:
            return cl.Buffer(self.context, cl.mem_flags.READ_WRITE, nbytes)
        except (cl.MemoryError, cl.RuntimeError) as error:
            raise DeviceMemoryError(
                f"{what} needs {nbytes / 2**20:.0f} MiB, which {self.device.name!r} refused: {error}"
            ) from error

    def finish(self) -> None:
        self.queue.finish()


class BoundKernel:
    """A kernel whose arguments stay the same from frame to frame, but for few: a launch costs one call."""

    def __init__(
        self,
        queue: cl.CommandQueue,
        kernel: cl.Kernel,
        size: tuple[int, ...],
        group: tuple[int, ...],
        arguments: tuple[Any, ...],
    ) -> None:
        self._arguments = list(arguments)  # OpenCL itself does not keep a kernel's buffers alive
        self._queue = queue
        self._kernel = kernel
        self._size = size
        self._group = group

    def __call__(self, size: tuple[int, ...] | None = None) -> None:
        """Enqueue it, over `size` work-items where that differs from launch to launch."""
        import pyopencl as cl

        cl.enqueue_nd_range_kernel(self._queue, self._kernel, size or self._size, self._group)

    def set(self, index: int, value: Any) -> None:
        """Another value for one argument, from the next launch on."""
        self._arguments[index] = value
        self._kernel.set_arg(index, _argument(value))
