"""The chip behind an OpenCL device or a WebGPU adapter, with one name for all its spellings.

Some backends compute on the central processor, whatever device or adapter there is.
"""

import re
from dataclasses import dataclass
from typing import Literal

from crowd.devices import chips
from crowd.devices.naming.raw_device import RawDevice

UNKNOWN_CHIP = "unknown chip"
UNKNOWN_PROCESSOR = "unknown processor"  # of a device that computed with WebAssembly
WEBASSEMBLY = "wasm"  # the backend
ON_PROCESSOR = frozenset({WEBASSEMBLY, "cpu"})  # the backends that compute there
CPU: Literal["cpu"] = "cpu"
GPU: Literal["gpu"] = "gpu"
# Platforms whose devices are processors, unless the device names a graphics chip.
CPU_PLATFORM = re.compile(r"portable computing language|pocl|oclgrind|intel\(r\) cpu|wasmtime", re.IGNORECASE)
# Devices that are processors on any platform: PoCL's, those of virtual machines, and software renderers.
CPU_DEVICE = re.compile(r"^(pthread|basic)\b|\bcpu\b|\bkvm processor\b", re.IGNORECASE)
SOFTWARE = re.compile(
    r"llvmpipe|lavapipe|softpipe|swiftshader|microsoft basic render|software (rasterizer|adapter)",
    re.IGNORECASE,
)


@dataclass(frozen=True)
class Processor:
    """A chip that computes. `name` comes from a rule, or is UNKNOWN_CHIP.

    For a browser it is often a family of chips, or a software renderer.
    """

    name: str
    kind: Literal["cpu", "gpu"]


def processor_of(raw: RawDevice) -> Processor:
    """The chip that computed, from the strings of a client.

    If the OpenCL device does not name its CPU, the CPU that the kernel reports is used, otherwise the system
    on a chip.
    """
    if raw.is_browser:
        return _of_adapter(raw)
    graphics = chips.graphics(raw.opencl_device)
    if graphics is not None:
        return Processor(graphics.name, GPU)
    named = chips.processor(raw.opencl_device)
    if named:
        return Processor(named, CPU)
    # A renderer's name may be that of the driver. A client that is no browser may describe an adapter.
    strings = (raw.opencl_device, raw.opencl_driver, raw.gpu_device, raw.gpu_description)
    software = raw.gpu_fallback == "true" or any(map(SOFTWARE.search, strings))
    if software or CPU_PLATFORM.search(raw.opencl_platform) or CPU_DEVICE.search(raw.opencl_device):
        return Processor(_of_the_system(raw) or UNKNOWN_CHIP, CPU)
    return Processor(UNKNOWN_CHIP, GPU)


def central_processor(soc: str, cpu: str) -> str:
    """The chip that computes with WebAssembly on a model with the system on a chip `soc` or the processor
    `cpu`; each may be empty.

    A phone is named by the first, a PC by the second.
    """
    return soc or cpu or UNKNOWN_PROCESSOR


def _of_adapter(raw: RawDevice) -> Processor:
    adapter = chips.adapter(
        raw.gpu_vendor,
        raw.gpu_architecture,
        (raw.gpu_description, raw.gpu_device),
        fallback=raw.gpu_fallback == "true",
    )
    if adapter.software:
        return Processor(adapter.name or _of_the_system(raw) or UNKNOWN_CHIP, CPU)
    return Processor(adapter.name or UNKNOWN_CHIP, GPU)


def _of_the_system(raw: RawDevice) -> str:
    return chips.processor(raw.cpu) or chips.system_on_chip(raw.soc_model, raw.board_platform, raw.cpu)
