"""The chip behind an OpenCL device or a WebGPU adapter, with one name for all its spellings."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from crowd.devices import chips
from crowd.devices.naming.browsers import is_browser
from crowd.devices.naming.names import text

UNKNOWN_CHIP = "unknown chip"
CPU: Literal["cpu"] = "cpu"
GPU: Literal["gpu"] = "gpu"
# Platforms whose devices are processors, unless the device names a graphics chip.
CPU_PLATFORM = re.compile(r"portable computing language|pocl|oclgrind|intel\(r\) cpu", re.IGNORECASE)
# Devices that are processors on any platform: PoCL's, and software renderers.
CPU_DEVICE = re.compile(r"^(pthread|cpu|basic)\b|llvmpipe|softpipe|swiftshader", re.IGNORECASE)


@dataclass(frozen=True)
class Processor:
    """A chip that computes. `name` comes from a rule, or is UNKNOWN_CHIP.

    For a browser it is often a family of chips, or a software renderer.
    """

    name: str
    kind: Literal["cpu", "gpu"]


def processor_of(raw: Mapping[str, Any]) -> Processor:
    """The chip that computed, from RAW, the strings of a client.

    If the OpenCL device does not name its CPU, the CPU that the kernel reports is used, otherwise the system
    on a chip.
    """
    if is_browser(raw):
        return _of_adapter(raw)
    device = text(raw, "opencl_device")
    graphics = chips.graphics(device)
    if graphics is not None:
        return Processor(graphics.name, GPU)
    named = chips.processor(device)
    if named:
        return Processor(named, CPU)
    if CPU_PLATFORM.search(text(raw, "opencl_platform")) or CPU_DEVICE.search(device):
        return Processor(_of_the_system(raw) or UNKNOWN_CHIP, CPU)
    return Processor(UNKNOWN_CHIP, GPU)


def _of_adapter(raw: Mapping[str, Any]) -> Processor:
    found = chips.adapter(
        text(raw, "gpu_vendor"),
        text(raw, "gpu_architecture"),
        (text(raw, "gpu_description"), text(raw, "gpu_device")),
        fallback=text(raw, "gpu_fallback") == "true",
    )
    if found.software:
        return Processor(found.name or _of_the_system(raw) or UNKNOWN_CHIP, CPU)
    return Processor(found.name or UNKNOWN_CHIP, GPU)


def _of_the_system(raw: Mapping[str, Any]) -> str:
    cpu = text(raw, "cpu")
    return chips.processor(cpu) or chips.system_on_chip(
        text(raw, "soc_model"), text(raw, "board_platform"), cpu
    )
