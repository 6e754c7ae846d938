"""What computed: the chip behind an OpenCL device or a WebGPU adapter, and its driver or browser.

Some backends compute on the central processor, whatever device or adapter there is.
"""

import re
from dataclasses import dataclass

from crowd.devices.naming import chips
from crowd.devices.naming.chips import CPU, GPU, OTHER, Processor
from crowd.devices.naming.raw_device import RawDevice
from crowd.devices.naming.rules import FLAGS, Rules, table

UNKNOWN_CHIP = "unknown chip"
UNKNOWN_PROCESSOR = "unknown processor"  # of a device that computed with WebAssembly
WEBASSEMBLY = "wasm"  # the backend
ON_PROCESSOR = frozenset({WEBASSEMBLY, "cpu"})  # the backends that compute there
# Platforms whose devices are processors, unless the device names a graphics chip.
CPU_PLATFORM = re.compile(r"portable computing language|pocl|oclgrind|intel\(r\) cpu|wasmtime", re.IGNORECASE)

_drivers = table("drivers")
PLATFORMS = Rules(_drivers["platforms"])
VERSIONS = {name: re.compile(pattern, FLAGS) for name, pattern in _drivers["versions"].items()}
BROWSERS = Rules(_drivers["browsers"])
MAJOR = re.compile(r"\d{1,3}(?!\d)", re.ASCII)


@dataclass(frozen=True)
class Driver:
    """A driver: its maker and version; empty if unknown."""

    name: str = ""
    version: str = ""

    def __str__(self) -> str:
        return f"{self.name} {self.version}".strip()


def processor_of(raw: RawDevice) -> Processor:
    """The chip that computed, from the strings of a client. Its name is UNKNOWN_CHIP if no rule matches.

    If the OpenCL device does not name its CPU, the CPU that the kernel reports is used, otherwise the system
    on a chip. A browser's chip is often a family of chips, or a software renderer.
    """
    if raw.is_browser:
        described = raw.gpu_description, raw.gpu_device
        fallback = raw.gpu_fallback == "true"
        found = chips.adapter(raw.gpu_vendor, raw.gpu_architecture, described, fallback=fallback)
    elif (graphics := chips.graphics(raw.opencl_device)) is not None:
        found = Processor(graphics.name, GPU)
    elif named := chips.processor(raw.opencl_device):
        found = Processor(named, CPU)
    elif _is_software(raw) or chips.CPU_DEVICE.search(raw.opencl_device):
        found = Processor("", CPU)
    else:
        found = Processor("", GPU)
    name = found.name or (_of_the_system(raw) if found.kind == CPU else "")
    return Processor(name or UNKNOWN_CHIP, found.kind)


def central_processor(soc: str, cpu: str) -> str:
    """The chip that computes with WebAssembly on a model with the system on a chip `soc` or the processor
    `cpu`; each may be empty.

    A phone is named by the first, a PC by the second.
    """
    return soc or cpu or UNKNOWN_PROCESSOR


def driver(raw: RawDevice) -> Driver:
    """The driver behind `raw`; Driver() if no rule matches its platform.

    For a browser, its name and major version: browsers implement WebGPU and WebAssembly, and hide the driver.
    """
    if raw.is_browser:
        name = BROWSERS.name(raw.browser)
        return Driver(name, major(raw.browser_version)) if name else Driver()
    name = PLATFORMS.name(raw.opencl_platform)
    match = VERSIONS.get(name, VERSIONS["others"]).search(raw.opencl_driver)
    return Driver(name, match[1] if match else "") if name else Driver()


def listed_browser(line: str) -> str:
    """The browser that `line` names; OTHER if it is not listed, empty for an empty `line`."""
    return BROWSERS.name(line) or (OTHER if line else "")


def major(version: str) -> str:
    """The major number of `version`; empty if it does not start with a number."""
    match = MAJOR.match(version)
    return match[0] if match else ""


def _is_software(raw: RawDevice) -> bool:
    """Whether a processor computes behind the API of graphics chips.

    The driver may have the renderer's name. A client may describe an adapter without being a browser.
    """
    strings = (raw.opencl_device, raw.opencl_driver, raw.gpu_device, raw.gpu_description)
    named = CPU_PLATFORM.search(raw.opencl_platform) or any(map(chips.RENDERER.search, strings))
    return bool(named) or raw.gpu_fallback == "true"


def _of_the_system(raw: RawDevice) -> str:
    return chips.processor(raw.cpu) or chips.system_on_chip(raw.soc_model, raw.board_platform, raw.cpu)
