"""OpenCL devices, programs, memory, and kernels with their arguments bound once.

This is the only module that imports pyopencl, on first use: a process that lists OpenCL devices and then
forks leaves its children with a hanging OpenCL, so importing this module must touch nothing.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from slam.configuration import ConfigurationError
from slam.devices.build import DEFAULT, Build
from slam.devices.device import Device, DeviceError, DeviceMemoryError
from slam.devices.layout import Layout

if TYPE_CHECKING:
    import pyopencl as cl

    Buffer = cl.Buffer
    Event = cl.Event

SHARED = Path(__file__).parents[1] / "dense" / "kernels"  # what the programs of every system may `#include`
INCLUDE = re.compile(r'^\s*#include "(.+)"$', re.MULTILINE)


def list_devices() -> list[Device]:
    """All OpenCL devices that can compile, best first: GPUs, accelerators, CPUs by version of the runtime.
    Empty where pyopencl cannot be used.

    Two installations of PoCL share one platform name; the newer one comes first. A runtime for the CPU that
    is older than the processor may be unable to compile for it: `list_refusals` says so.
    """
    devices = [device for device in _present() if _refusal(device) is None]
    rank = {"gpu": 0, "accelerator": 1, "cpu": 2, "other": 3}
    return sorted(devices, key=lambda d: (rank[d.kind], [-part for part in _numbers(d.driver)]))


def load_error() -> ImportError | None:
    """Why pyopencl cannot be used here: it is not installed, or does not load; None where it can."""
    try:
        # A folder of that name may be all that an uninstallation or PoCL's wheel left there.
        from pyopencl import get_platforms  # noqa: F401
    except ImportError as error:
        return error
    return None


def list_refusals() -> list[str]:
    """A line for each device that cannot compile anything, with the compiler's reason."""
    return [f"{device.label}: {reason}" for device in _present() if (reason := _refusal(device))]


def _refusal(device: Device) -> str | None:
    """Why the compiler of a CPU cannot be used; None where it can."""
    if device.kind != "cpu":
        return None
    key = (device.name, device.version, device.driver)
    if key not in _refusals:
        _refusals[key] = _compile_nothing(device)
    return _refusals[key]


_refusals: dict[tuple[str, str, str], str | None] = {}  # of this process


def _compile_nothing(device: Device) -> str | None:
    import pyopencl as cl

    try:
        cl.Program(cl.Context([device.handle]), "kernel void nothing() {}").build()
    except (cl.LogicError, cl.RuntimeError) as error:
        match = re.search(r"error: (.+)", str(error))
        return match[1] if match else str(error).splitlines()[0]
    return None


def _present() -> list[Device]:
    if load_error():
        return []
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
    return devices


def _numbers(version: str) -> list[int]:
    """Release numbers in a version string, padded: 3.1 sorts above 3.0-rc2."""
    numbers = [int(digits) for digits in re.findall(r"\d+", version.split("-")[0])]
    return [*numbers, 0, 0, 0, 0][:4]


def _describe(platform: cl.Platform, handle: cl.Device) -> Device:
    import pyopencl as cl

    kinds = {cl.device_type.GPU: "gpu", cl.device_type.CPU: "cpu", cl.device_type.ACCELERATOR: "accelerator"}
    bits = handle.type
    return Device(
        backend="opencl",
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


def source_text(source: Path) -> str:
    """The text of a `.cl` file with the headers that it includes, of its folder or of SHARED, in their place.

    Compilers get one text and no folder: some drivers split an include path at its spaces.
    """
    included: set[str] = set()

    def expanded(path: Path) -> str:
        def header(match: re.Match[str]) -> str:
            name = match[1]
            if name in included:
                return ""
            included.add(name)
            return expanded(next(f / name for f in (source.parent, SHARED) if (f / name).is_file()))

        return INCLUDE.sub(header, path.read_text(encoding="utf-8"))

    return expanded(source)


def defined(source: Path, name: str) -> int:
    """The whole number of `#define NAME` in a file of kernels: host and kernels share the constant."""
    match = re.search(rf"^#define {name} (\d+)(?![\w.])", source.read_text(encoding="utf-8"), re.MULTILINE)
    if match is None:
        raise ValueError(f"{source.name} defines no whole number {name}")
    return int(match[1])


def _part(device: Device, threads: int) -> Device:
    """The part of `device` that has `threads` compute units, a thread of a processor each."""
    import pyopencl as cl

    most = device.compute_units
    if threads > most:
        raise ConfigurationError(
            f"build_threads={threads}: {device.name!r} has {most}: give {most} or fewer, or 0"
        )
    try:
        handle, *_ = device.handle.create_sub_devices([cl.device_partition_property.BY_COUNTS, threads])
    except (cl.LogicError, cl.RuntimeError) as error:
        raise ConfigurationError(
            f"build_threads={threads}: {device.name!r} cannot be divided ({error}): give 0"
        ) from None
    return replace(device, compute_units=threads, handle=handle)


class Session:
    """A context and an in-order queue on one device, with the programs built on it.

    `layout` (default: that of `build`, else by the kind of device) says how kernels over images are laid out.
    Configurations reach kernels as arguments, never as macros: one build serves them all. `device` has fewer
    compute units where `build` names a number of threads. Raises ConfigurationError where it cannot.
    """

    def __init__(self, device: Device, layout: Layout | None = None, build: Build = DEFAULT) -> None:
        import pyopencl as cl

        self.build = build
        self.device = device if build.build_threads == 0 else _part(device, build.build_threads)
        self.layout = layout or build.layout or Layout.for_device(device.kind)
        with self._translated("a session"):
            self._context = cl.Context([self.device.handle])
            self._queue = self._open_queue()
        self._programs: dict[tuple[Path, str], cl.Program] = {}

    def _open_queue(self) -> cl.CommandQueue:
        """A queue with profiling, where the driver supports it. The context alone does not say which part."""
        import pyopencl as cl

        device = self.device.handle
        try:
            return cl.CommandQueue(self._context, device, cl.command_queue_properties.PROFILING_ENABLE)
        except cl.Error:
            return cl.CommandQueue(self._context, device)

    def program(self, source: Path, declarations: str = "") -> cl.Program:
        """The program of one `.cl` file after the text `declarations`, built on first use.

        Raises DeviceError where the driver does not compile it.
        """
        import pyopencl as cl

        if (source, declarations) not in self._programs:
            options = [
                *self.build.options,
                *(f"-D{name}={value}" for name, value in self.layout.macros().items()),
            ]
            if self.device.double_precision:
                options.append("-DDOUBLE_PRECISION")
            text = declarations + source_text(source)
            with self._translated(f"compiling {source.name}"):
                self._programs[source, declarations] = cl.Program(self._context, text).build(options)
        return self._programs[source, declarations]

    def kernel(
        self,
        source: Path,
        name: str,
        size: tuple[int, ...],
        *arguments: Any,
        group: tuple[int, ...] | None = None,
        declarations: str = "",
    ) -> BoundKernel:
        """The kernel `name` of a file over at least `size` work-items, with its arguments set.

        `group` is the size of the work-groups, by default one work-item each: that leaves a kernel's own
        loops to the compiler. A group that is too large for the device is made smaller. Python's int and
        float become OpenCL's 32-bit ones. Raises DeviceError where the device refuses the kernel.
        """
        import pyopencl as cl

        program = self.program(source, declarations)
        with self._translated(f"the kernel {name}"):
            kernel = cl.Kernel(program, name)
            kernel.set_args(*(_argument(value) for value in arguments))
            most = kernel.get_work_group_info(cl.kernel_work_group_info.WORK_GROUP_SIZE, self.device.handle)
        fitting = _fitting(group or (1,) * len(size), most)
        whole = tuple(-(-n // g) * g for n, g in zip(size, fitting, strict=True))
        return BoundKernel(self, kernel, name, whole, fitting, arguments)

    def image_kernel(self, source: Path, name: str, width: int, height: int, *arguments: Any) -> BoundKernel:
        """The kernel `name` of a file over an image, laid out as this session's `layout` says."""
        size, group = self.layout.over(width, height)
        return self.kernel(source, name, size, *arguments, group=group)

    def buffer(self, nbytes: int, what: str = "a buffer") -> Buffer:
        """Device memory of `nbytes`. Raises DeviceMemoryError, naming `what` needs it and what is allowed."""
        import pyopencl as cl

        self.device.check_allocation(nbytes, what)
        try:
            return cl.Buffer(self._context, cl.mem_flags.READ_WRITE, nbytes)
        except cl.Error as error:
            raise DeviceMemoryError(
                f"{what} needs {nbytes / 2**20:.0f} MiB, which {self.device.name!r} refused: {error}"
            ) from error

    def upload(self, buffer: Buffer, values: npt.NDArray[Any], wait: bool = True) -> Event:
        """Copy `values` into `buffer`.

        Without `wait`, keep the event: dropping it waits for the copy, too.
        """
        import pyopencl as cl

        with self._translated("an upload"):
            return cl.enqueue_copy(self._queue, buffer, np.ascontiguousarray(values), is_blocking=wait)

    def download(self, buffer: Buffer, values: npt.NDArray[Any], offset: int = 0) -> None:
        """Fill `values` from `buffer`, beginning `offset` bytes after its start, once all kernels so far are
        done.
        """
        import pyopencl as cl

        with self._translated("a download"):
            cl.enqueue_copy(self._queue, values, buffer, src_offset=offset)

    def copy(self, target: Buffer, source: Buffer, nbytes: int, offset: int = 0) -> None:
        """Copy the first `nbytes` of `source` into `target`, to `offset` bytes after its start, on the
        device."""
        import pyopencl as cl

        with self._translated("a copy"):
            cl.enqueue_copy(self._queue, target, source, byte_count=nbytes, dst_offset=offset)

    def fill(self, buffer: Buffer, nbytes: int, word: int = 0) -> None:
        """Write `word`, 32 bits, over the first `nbytes` of `buffer`."""
        import pyopencl as cl

        with self._translated("a fill"):
            cl.enqueue_fill_buffer(self._queue, buffer, np.array(word, np.uint32), 0, nbytes)

    def finish(self) -> None:
        """Wait until all work so far is done."""
        with self._translated("waiting"):
            self._queue.finish()

    def span(self, first: Event, last: Event) -> tuple[int, int] | None:
        """When `first` started and `last` ended, nanoseconds of the device's clock.

        None where the driver does not report it, or reports an end before the start.
        """
        import pyopencl as cl

        try:
            start, end = first.profile.start, last.profile.end
        except cl.Error:
            return None
        return (start, end) if 0 < start <= end else None

    def launch(self, kernel: cl.Kernel, name: str, size: tuple[int, ...], group: tuple[int, ...]) -> Event:
        """Enqueue `kernel`, called `name`; its event says when it ran."""
        import pyopencl as cl

        try:
            return cl.enqueue_nd_range_kernel(self._queue, kernel, size, group)
        except cl.Error as error:
            raise self._error(f"the kernel {name} over {size} in groups of {group}", error) from error

    @contextmanager
    def _translated(self, what: str) -> Iterator[None]:
        import pyopencl as cl

        try:
            yield
        except cl.Error as error:
            raise self._error(what, error) from error

    def _error(self, what: str, error: Exception) -> DeviceError:
        return DeviceError(f"{self.device.name!r} refused {what}: {' '.join(str(error).split())[:500]}")


class BoundKernel:
    """A kernel that keeps its arguments from frame to frame, except a few: a launch costs one call."""

    def __init__(
        self,
        session: Session,
        kernel: cl.Kernel,
        name: str,
        size: tuple[int, ...],
        group: tuple[int, ...],
        arguments: tuple[Any, ...],
    ) -> None:
        self._arguments = list(arguments)  # OpenCL itself does not keep a kernel's buffers alive
        self._session = session
        self._kernel = kernel
        self._name = name
        self._size = size
        self._group = group

    def __call__(self, size: tuple[int, ...] | None = None) -> Event:
        """Enqueue it, over `size` work-items where the number varies."""
        return self._session.launch(self._kernel, self._name, size or self._size, self._group)

    def set(self, index: int, value: Any) -> None:
        """Another value for one argument, from the next launch on."""
        self._arguments[index] = value
        self._kernel.set_arg(index, _argument(value))


def _argument(value: Any) -> Any:
    if isinstance(value, int):
        return np.int32(value)
    if isinstance(value, float):
        return np.float32(value)
    return value


def _fitting(group: tuple[int, ...], most: int) -> tuple[int, ...]:
    """`group`, halved where it is longest until it has at most `most` work-items."""
    sizes = list(group)
    while np.prod(sizes) > max(most, 1):
        longest = max(range(len(sizes)), key=lambda axis: (sizes[axis], axis))
        sizes[longest] = max(sizes[longest] // 2, 1)
    return tuple(sizes)
