"""What a device is, whichever backend drives it, and what can go wrong there."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

BACKENDS = ("opencl", "webgpu")


class DeviceError(RuntimeError):
    """Something that a device or its driver cannot do; the message says what would help."""


class NoDeviceError(DeviceError):
    """No device is present, or none whose label contains what was asked for."""


class DeviceMemoryError(DeviceError):
    """The device allows less memory than a configuration needs."""


@dataclass(frozen=True)
class Device:
    """One device of one backend. `kind` is "gpu", "cpu", "accelerator" or "other"; sizes in bytes.

    `handle` is the backend's own object.
    """

    backend: str
    platform: str
    version: str
    name: str
    driver: str
    kind: str
    compute_units: int
    max_allocation: int
    global_memory: int
    double_precision: bool
    handle: Any = field(repr=False)

    @property
    def label(self) -> str:
        """What `--device` matches: name, platform, version and driver."""
        return f"{self.name} ({self.platform}, {self.version}, driver {self.driver})"

    def describe(self) -> dict[str, str]:
        """What a report says of the device."""
        return {"platform": self.platform, "name": self.name, "driver": self.driver, "backend": self.backend}

    def check_allocation(self, nbytes: int, what: str) -> None:
        """Raise DeviceMemoryError where WHAT needs one buffer of NBYTES and the device allows less."""
        if nbytes > self.max_allocation:
            raise DeviceMemoryError(
                f"{what} needs one buffer of {nbytes / 2**20:.0f} MiB, {self.name!r} allows "
                f"at most {self.max_allocation / 2**20:.0f} MiB"
            )
