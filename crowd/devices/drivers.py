"""OpenCL drivers by name and version, out of the strings that they give: to tell which release computed."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from crowd.devices.names import text


@dataclass(frozen=True)
class Driver:
    """A driver: who wrote it, and its version in that maker's counting; empty where nothing tells."""

    name: str = ""
    version: str = ""

    def __str__(self) -> str:
        return f"{self.name} {self.version}".strip()


# By the platform's name; the version is the pattern's first group in the driver's own string.
DRIVERS = tuple(
    (re.compile(platform, re.IGNORECASE), name, re.compile(version, re.IGNORECASE))
    for platform, name, version in (
        # "3.0 v1.r44p1-00eac0.<digest of the build>": the digest would tell the phone's firmware.
        (r"\barm\b", "Mali", r"\b(r\d+p\d+)"),
        # "OpenCL 2.0 QUALCOMM build: commit #... Compiler E031.37.12.07"
        (r"qualcomm|snapdragon", "Adreno", r"compiler (e[\d.]+)"),
        (r"portable computing language|pocl", "PoCL", r"([\d.]+\w*)"),
        (r"rusticl", "rusticl", r"([\d.]+)"),
        (r"nvidia", "NVIDIA", r"([\d.]+)"),
        (r"amd|advanced micro devices", "AMD", r"([\d.]+)"),
        (r"intel", "Intel", r"([\d.]+)"),
        (r"apple", "Apple", r"([\d.]+)"),
        (r"powervr|imagination", "PowerVR", r"([\d.]+(?:@\d+)?)"),
    )
)


def driver(raw: Mapping[str, Any]) -> Driver:
    """The driver behind RAW; Driver() where its platform is not known by any rule."""
    platform, given = text(raw, "opencl_platform"), text(raw, "opencl_driver")
    for known, name, version in DRIVERS:
        if known.search(platform):
            found = version.search(given)
            return Driver(name, found[1] if found else "")
    return Driver()
