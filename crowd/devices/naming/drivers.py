"""The name and version of the OpenCL driver, of wasmtime, or of the browser, that computed."""

import re
from dataclasses import dataclass

from crowd.devices.naming import browsers
from crowd.devices.naming.raw_device import RawDevice

FLAGS = re.IGNORECASE | re.ASCII
# "560.35.03", "24.35.30872", "3602.0"; not the start of a longer number.
NUMBERS = r"(?<![\d.])(\d{1,4}(?:\.\d{1,6}){0,3})(?![\d.]*\d)"


@dataclass(frozen=True)
class Driver:
    """A driver: its maker and version; empty if unknown."""

    name: str = ""
    version: str = ""

    def __str__(self) -> str:
        return f"{self.name} {self.version}".strip()


# By the platform's name. The version is the first group of the second pattern in the driver's string. It only
# matches numbers, so that no text of strangers gets in.
DRIVERS = tuple(
    (re.compile(platform, FLAGS), name, re.compile(version, FLAGS))
    for platform, name, version in (
        # "3.0 v1.r44p1-00eac0.<digest of the build>": the digest would reveal the phone's firmware.
        (r"\barm\b", "Mali", r"\b(r\d{1,3}p\d{1,2})(?!\d)"),
        # "OpenCL 2.0 QUALCOMM build: commit #... Compiler E031.37.12.07"
        (r"qualcomm|snapdragon", "Adreno", r"compiler (e\d{3}(?:\.\d{2}){1,3})(?![\d.])"),
        (r"portable computing language|pocl", "PoCL", NUMBERS),
        (r"rusticl", "rusticl", NUMBERS),
        (r"wasmtime", "wasmtime", NUMBERS),
        (r"nvidia", "NVIDIA", NUMBERS),
        (r"amd|advanced micro devices", "AMD", NUMBERS),
        (r"intel", "Intel", NUMBERS),
        (r"apple", "Apple", NUMBERS),
        (r"powervr|imagination", "PowerVR", r"(?<![\d.])(\d{1,2}\.\d{1,3}(?:@\d{6,8})?)(?![\d.@])"),
    )
)


def driver(raw: RawDevice) -> Driver:
    """The driver behind `raw`; Driver() if no rule matches its platform.

    For a browser, its name and major version: browsers implement WebGPU and WebAssembly, and hide the driver.
    """
    if raw.is_browser:
        name = browsers.listed_name(raw.browser)
        return Driver() if name in ("", browsers.OTHER) else Driver(name, browsers.major(raw.browser_version))
    for platform, name, version in DRIVERS:
        if platform.search(raw.opencl_platform):
            match = version.search(raw.opencl_driver)
            return Driver(name, match[1] if match else "")
    return Driver()
