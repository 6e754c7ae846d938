"""A device, independent of its backend, and its errors."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

BACKENDS = ("opencl", "webgpu", "wasm")


class DeviceError(RuntimeError):
    """Something that a device or its driver cannot do; the message suggests a remedy."""


class NoDeviceError(DeviceError):
    """No device is present, or no label contains the requested text."""


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
        """The text that `--device` matches: name, platform, version and driver."""
        return f"{self.name} ({self.platform}, {self.version}, driver {self.driver})"

    @property
    def threads(self) -> int | None:
        """The number of threads that execute kernels over WebAssembly; otherwise None: the driver decides."""
        return self.compute_units if self.backend == "wasm" else None

    def describe(self) -> dict[str, str]:
        """The device in a report."""
        return {"platform": self.platform, "name": self.name, "driver": self.driver, "backend": self.backend}

    def check_allocation(self, nbytes: int, what: str) -> None:
        """Raise DeviceMemoryError where `what` needs one buffer of `nbytes` and the device allows less."""
        if nbytes > self.max_allocation:
            raise DeviceMemoryError(
                f"{what} needs one buffer of {nbytes / 2**20:.0f} MiB, {self.name!r} allows "
                f"at most {self.max_allocation / 2**20:.0f} MiB"
            )
