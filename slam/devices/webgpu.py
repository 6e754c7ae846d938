"""WebGPU devices through wgpu-native: pipelines, memory, and one submission of launches at a time.

This is the only module that imports wgpu, on first use: importing this module touches nothing.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from slam.devices.device import Device, DeviceError, DeviceMemoryError
from slam.devices.layout import Layout

if TYPE_CHECKING:
    from wgpu import GPUAdapter, GPUBindGroup, GPUComputePipeline
    from wgpu import GPUBuffer as Buffer

# The default limits of WebGPU, which every browser grants. wgpu-py would request the adapter's limits.
LIMITS = MappingProxyType(
    {
        "max-storage-buffer-binding-size": 128 * 2**20,
        "max-buffer-size": 256 * 2**20,
        "max-storage-buffers-per-shader-stage": 8,
        "max-uniform-buffers-per-shader-stage": 12,
        "max-uniform-buffer-binding-size": 64 * 2**10,
        "max-bindings-per-bind-group": 1000,
        "max-bind-groups": 4,
        "max-compute-workgroup-storage-size": 16 * 2**10,
        "max-compute-invocations-per-workgroup": 256,
        "max-compute-workgroup-size-x": 256,
        "max-compute-workgroup-size-y": 256,
        "max-compute-workgroup-size-z": 64,
        "max-compute-workgroups-per-dimension": 65535,
        "min-storage-buffer-offset-alignment": 256,
        "min-uniform-buffer-offset-alignment": 256,
    }
)
ALIGNMENT = 256  # of a part of a uniform buffer
LAYOUT = Layout("pixels", (16, 8))
KINDS = {"DiscreteGPU": "gpu", "IntegratedGPU": "gpu", "CPU": "cpu"}
# The software of these backends covers less than WebGPU, or repeats the devices of another backend.
SKIPPED = ("OpenGL", "OpenGLES", "D3D11", "Null")


def list_devices() -> list[Device]:
    """All WebGPU devices, best first: GPUs, others, then CPUs. Empty where wgpu is not installed."""
    try:
        import wgpu
    except ImportError:
        return []
    try:
        adapters = wgpu.gpu.enumerate_adapters_sync()
    except (wgpu.GPUError, RuntimeError, OSError):  # no driver that wgpu supports
        return []
    rank = {"gpu": 0, "other": 1, "cpu": 2}
    usable = [a for a in adapters if a.info["backend_type"] not in SKIPPED and _keeps_limits(a)]
    devices = [_describe(adapter) for adapter in usable]
    return sorted(devices, key=lambda device: rank[device.kind])


def _keeps_limits(adapter: GPUAdapter) -> bool:
    """Whether `adapter` has the default limits at least. An alignment is better where it is smaller."""
    return all(
        adapter.limits[name] <= value if name.startswith("min-") else adapter.limits[name] >= value
        for name, value in LIMITS.items()
    )


def _describe(adapter: GPUAdapter) -> Device:
    import wgpu
    from wgpu.backends import wgpu_native

    info = adapter.info
    return Device(
        backend="webgpu",
        platform=info["backend_type"],
        version=f"wgpu-py {wgpu.__version__}, wgpu-native {wgpu_native.__version__}",
        name=info["device"],
        driver=info["description"] or "unknown",
        kind=KINDS.get(info["adapter_type"], "other"),
        compute_units=0,
        max_allocation=LIMITS["max-storage-buffer-binding-size"],
        global_memory=0,
        double_precision=False,
        handle=adapter,
    )


@dataclass(frozen=True)
class Launch:
    """A pipeline with its bindings, over so many workgroups in each direction."""

    pipeline: GPUComputePipeline
    bindings: GPUBindGroup
    groups: tuple[int, ...]


@dataclass(frozen=True)
class Binding:
    """`nbytes` of `buffer` from `offset` on, as a kernel sees them."""

    buffer: Buffer
    offset: int
    nbytes: int


class WebGPUSession:
    """A WebGPU device with the default limits and no optional feature, and the pipelines compiled on it.

    Kernels are laid out by pixels. Raises DeviceError where the driver refuses something or loses the device.
    """

    def __init__(self, device: Device, layout: Layout | None = None) -> None:
        if layout is not None and layout != LAYOUT:
            raise ValueError(f"kernel layout {layout}: WebGPU's kernels are laid out as {LAYOUT}")
        self.device = device
        self.layout = LAYOUT
        with self._translated("a session"):
            self._device = device.handle.request_device_sync(required_limits=dict(LIMITS))
        self._pipelines: dict[tuple[str, str, tuple[str, ...]], GPUComputePipeline] = {}

    def buffer(self, nbytes: int, what: str = "a buffer") -> Buffer:
        """Storage of `nbytes`, all 0.

        Raises DeviceMemoryError, naming `what` needs it and what is allowed.
        """
        import wgpu

        self.device.check_allocation(nbytes, what)
        usage = wgpu.BufferUsage.STORAGE | wgpu.BufferUsage.COPY_SRC | wgpu.BufferUsage.COPY_DST
        with self._translated(f"{what} of {nbytes / 2**20:.0f} MiB"):
            return self._device.create_buffer(size=nbytes, usage=usage)

    def uniforms(self, parts: Sequence[bytes]) -> list[Binding]:
        """`parts` in one uniform buffer, each a binding of its own."""
        import wgpu

        sizes = [-(-len(part) // ALIGNMENT) * ALIGNMENT for part in parts]
        if not sizes:
            return []
        data = b"".join(part.ljust(size, b"\0") for part, size in zip(parts, sizes, strict=True))
        with self._translated("the parameters of kernels"):
            buffer = self._device.create_buffer_with_data(data=data, usage=wgpu.BufferUsage.UNIFORM)
        offsets = [sum(sizes[:index]) for index in range(len(sizes))]
        return [Binding(buffer, offset, len(part)) for offset, part in zip(offsets, parts, strict=True)]

    def readback(self, nbytes: int) -> Buffer:
        """Memory of `nbytes` that `run` copies to and the host reads."""
        import wgpu

        with self._translated("memory to read back"):
            return self._device.create_buffer(
                size=nbytes, usage=wgpu.BufferUsage.MAP_READ | wgpu.BufferUsage.COPY_DST
            )

    def pipeline(self, text: str, name: str, bindings: tuple[str, ...]) -> GPUComputePipeline:
        """The kernel `name` of the WGSL `text`, compiled on first use.

        `bindings` holds the kind of each binding of group 0: "storage", "read-only-storage" or "uniform".
        """
        import wgpu

        key = (text, name, bindings)
        if key not in self._pipelines:
            with self._translated(f"the kernel {name}"):
                entries = [
                    {"binding": index, "visibility": wgpu.ShaderStage.COMPUTE, "buffer": {"type": kind}}
                    for index, kind in enumerate(bindings)
                ]
                group = self._device.create_bind_group_layout(entries=entries)
                self._pipelines[key] = self._device.create_compute_pipeline(
                    layout=self._device.create_pipeline_layout(bind_group_layouts=[group]),
                    compute={
                        "module": self._device.create_shader_module(label=name, code=text),
                        "entry_point": name,
                    },
                )
        return self._pipelines[key]

    def bind(self, pipeline: GPUComputePipeline, bindings: Sequence[Binding]) -> GPUBindGroup:
        """The bind group of a launch of `pipeline`, in the order of its bindings."""
        entries = [
            {
                "binding": index,
                "resource": {"buffer": binding.buffer, "offset": binding.offset, "size": binding.nbytes},
            }
            for index, binding in enumerate(bindings)
        ]
        with self._translated("the bindings of a kernel"):
            return self._device.create_bind_group(layout=pipeline.get_bind_group_layout(0), entries=entries)

    def upload(self, buffer: Buffer, values: npt.NDArray[Any], offset: int = 0) -> None:
        """Copy `values` into `buffer`, from `offset` bytes on, filled up with 0 to whole 32-bit words."""
        data = np.ascontiguousarray(values).tobytes() if values.nbytes % 4 else np.ascontiguousarray(values)
        if isinstance(data, bytes):
            data += b"\0" * (-len(data) % 4)
        with self._translated("an upload"):
            self._device.queue.write_buffer(buffer, offset, data)

    def run(self, launches: Iterable[Launch], result: Binding, target: Buffer) -> bytes:
        """Execute `launches` one after another, copy `result` to `target`, and wait for its bytes.

        `target` is of `readback`, at least as large.
        """
        with self._translated("the work of a frame"):
            encoder = self._device.create_command_encoder()
            compute = encoder.begin_compute_pass()
            for launch in launches:
                compute.set_pipeline(launch.pipeline)
                compute.set_bind_group(0, launch.bindings)
                compute.dispatch_workgroups(*launch.groups)
            compute.end()
            encoder.copy_buffer_to_buffer(result.buffer, result.offset, target, 0, result.nbytes)
            self._device.queue.submit([encoder.finish()])
            target.map_sync("READ", 0, result.nbytes)
            try:
                return bytes(target.read_mapped(0, result.nbytes))
            finally:
                target.unmap()

    @contextmanager
    def _translated(self, what: str) -> Iterator[None]:
        import wgpu

        try:
            yield
        except wgpu.GPUOutOfMemoryError as error:
            raise DeviceMemoryError(self._message(what, error)) from error
        except (wgpu.GPUError, wgpu.GPUPipelineError, RuntimeError) as error:
            raise DeviceError(self._message(what, error)) from error

    def _message(self, what: str, error: Exception) -> str:
        reason = " ".join(str(error).split())[:500]
        if "lost" in reason.lower():
            return f"{self.device.name!r} was lost during {what}; start again: {reason}"
        return f"{self.device.name!r} refused {what}: {reason}"
