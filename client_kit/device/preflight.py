"""Obstacles to measuring now, with remedies; checked before a session begins."""

import os
import sys
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from client_kit.device import condition
from client_kit.errors import CannotMeasureError
from client_kit.home import Home
from slam.devices.layout import Layout

if TYPE_CHECKING:
    from slam.devices.device import Device

BATTERY, POWER_SAVING, THROTTLING, LOAD, DISK = "battery", "power-saving", "throttling", "load", "disk"
# Concerns that a participant may ignore.
IGNORABLE = (BATTERY, POWER_SAVING, THROTTLING)
BUSY_SHARE = 0.5
# A voxel's word (slam/kfusion/plan.py). By rows its weight lies in a second buffer.
WORD_BYTES, WEIGHT_BYTES = 4, 1
SMALLEST_VOLUME = 64
# Space for spool, documents and SQLite's temporary files.
NEEDED_DISK_BYTES = 16 * 2**20


@dataclass(frozen=True)
class Concern:
    """A reason against measuring now; `stops`: measuring is refused."""

    name: str
    text: str
    stops: bool


def concerns(
    home: Home, root: Path = Path("/"), system: str = sys.platform, download: int = 0
) -> list[Concern]:
    """All reasons against measuring now; unknown values are ignored.

    `download` is the number of bytes of a sequence still to be stored.
    """
    reasons = []
    charge = condition.battery(root, system)
    if charge is not None and charge.low:
        reasons.append(
            Concern(BATTERY, f"the battery is at {charge.percent:.0f} %: plug the device in", True)
        )
    if condition.power_saving(root, system):
        text = "power saving is on, which limits the clocks: switch it off"
        reasons.append(Concern(POWER_SAVING, text, True))
    slowed = condition.throttling(root, system)
    if slowed is not None:
        text = f"the device throttles, {slowed}: let it cool, out of its case and the sun"
        reasons.append(Concern(THROTTLING, text, True))
    busy, processors = condition.load(root, system), os.cpu_count() or 1
    if busy is not None and busy > BUSY_SHARE * processors:
        text = f"other programs keep this device busy (load {busy:.1f} on {processors} processors): times "
        text += "will be less steady"
        reasons.append(Concern(LOAD, text, False))
    free = condition.free_disk(home.path)
    needed = NEEDED_DISK_BYTES + download
    if free is not None and free < needed:
        text = f"{free >> 20} MiB are left on the disk of {home.path}, {needed >> 20} are needed"
        reasons.append(Concern(DISK, f"{text}: a session could not be kept", True))
    return reasons


def require_fit(found: Iterable[Concern], ignored: Collection[str] = ()) -> list[Concern]:
    """The concerns that do not stop. Raises CannotMeasureError for the first that stops."""
    passed = []
    for concern in found:
        if concern.stops and concern.name not in ignored:
            remedy = f", or add --ignore {concern.name}" if concern.name in IGNORABLE else ""
            raise CannotMeasureError(f"{concern.text}{remedy}")
        passed.append(concern)
    return passed


def too_large(
    configurations: Mapping[str, Mapping[str, Any]], device: "Device", root: Path = Path("/")
) -> dict[str, str]:
    """The reasons of those `configurations` (parameters by name) that this device lacks memory for.

    Checking in advance matters on phones: there the system ends a program that takes the last memory, and the
    session with it. A device uses the machine's memory unless it is a GPU with its own. WebGPU does not
    report its size.
    """
    free = condition.free_memory(root)
    opencl_by_rows = device.backend == "opencl" and not Layout.for_device(device.kind).pixels
    by_rows = device.backend == "wasm" or opencl_by_rows
    voxel_bytes = WORD_BYTES + (WEIGHT_BYTES if by_rows else 0)
    reasons = {}
    for name, parameters in configurations.items():
        resolution = parameters.get("volume_resolution")
        if not isinstance(resolution, int) or resolution <= SMALLEST_VOLUME:
            continue
        buffer, total = WORD_BYTES * resolution**3, voxel_bytes * resolution**3
        needs = f"volume_resolution={resolution} needs"
        if buffer > device.max_allocation:
            allowed = _mib(device.max_allocation)
            reasons[name] = f"{needs} one buffer of {_mib(buffer)}, the device allows {allowed}"
        elif 0 < device.global_memory < total:
            reasons[name] = f"{needs} {_mib(total)}, the device has {_mib(device.global_memory)}"
        elif free is not None and _shares_memory(device) and total > free:
            reasons[name] = f"{needs} {_mib(total)}, {_mib(free)} are free: end other programs"
    return reasons


def unsupported(configurations: Mapping[str, Collection[str]], backend: str) -> dict[str, str]:
    """The reasons of those `configurations` (backends by name) that `backend` cannot run.

    The limit on the memory of WebAssembly is that of browsers: this client runs there what OpenCL runs.
    """
    needed = "opencl" if backend == "wasm" else backend
    return {
        name: f"{name} does not run on {backend}: it needs {' or '.join(backends)}"
        for name, backends in configurations.items()
        if needed not in backends
    }


def _shares_memory(device: "Device") -> bool:
    if device.kind == "cpu":
        return True
    return bool(getattr(device.handle, "host_unified_memory", True))


def _mib(size: int) -> str:
    return f"{size / 2**20:.0f} MiB"
