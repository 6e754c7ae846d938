"""Who computed: the chip behind an OpenCL device or a browser's GPU, by one name for all spellings of it."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from crowd.devices import chips
from crowd.devices.names import text

UNKNOWN_CHIP = "unknown chip"
CPU: Literal["cpu"] = "cpu"
GPU: Literal["gpu"] = "gpu"
# Platforms whose devices are the processor itself, unless the device names a graphics chip.
CPU_PLATFORM = re.compile(r"portable computing language|pocl|oclgrind|intel\(r\) cpu", re.IGNORECASE)
# Devices that are the processor itself, whatever the platform: PoCL's, and renderers without a graphics chip.
CPU_DEVICE = re.compile(r"^(pthread|cpu|basic)\b|llvmpipe|softpipe|swiftshader", re.IGNORECASE)


@dataclass(frozen=True)
class Processor:
    """A chip that computes. `name` comes from a rule, or is UNKNOWN_CHIP."""

    name: str
    kind: Literal["cpu", "gpu"]


def processor_of(raw: Mapping[str, Any]) -> Processor:
    """The chip that computed for the device behind RAW, the client's strings.

    A CPU that the OpenCL device does not name is the one that the kernel names, else the system on a chip. A
    browser names the maker and the architecture of a GPU, and the GPU itself where its user permits.
    """
    device = text(raw, "opencl_device") or browser_gpu(raw)
    graphics = chips.graphics(device)
    if graphics is not None:
        return Processor(graphics.name, GPU)
    named = chips.processor(device)
    if named:
        return Processor(named, CPU)
    if CPU_PLATFORM.search(text(raw, "opencl_platform")) or CPU_DEVICE.search(device):
        return Processor(_of_the_system(raw) or UNKNOWN_CHIP, CPU)
    return Processor(UNKNOWN_CHIP, GPU)


def browser_gpu(raw: Mapping[str, Any]) -> str:
    """What a browser says of the GPU; empty for other clients."""
    described = text(raw, "gpu_description")
    known = chips.graphics(described) or CPU_DEVICE.search(described)
    return described if known else f"{text(raw, 'gpu_vendor')} {text(raw, 'gpu_architecture')}".strip()


def _of_the_system(raw: Mapping[str, Any]) -> str:
    cpu = text(raw, "cpu")
    return chips.processor(cpu) or chips.system_on_chip(
        text(raw, "soc_model"), text(raw, "board_platform"), cpu
    )
