"""The description of a device: raw strings, null where unknown, nothing about its owner.

Only the sources named here are read. They contain no serial numbers, network addresses, host or user names.
The server interprets the strings, so that a wrong guess can be corrected later.
"""

import math
import os
import platform
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from client_kit.device.sources import line, number, output, program, read

if TYPE_CHECKING:
    from slam.devices.device import Device

Identity = dict[str, str | None]

FIELDS = (
    "os",
    "os_version",
    "architecture",
    "manufacturer",
    "brand",
    "model",
    "device",
    "board",
    "hardware",
    "soc_manufacturer",
    "soc_model",
    "board_platform",
    "egl",
    "cpu",
    "cpu_parts",
    "cpu_count",
    "cpu_max_mhz",
    "memory_gib",
    "opencl_platform",
    "opencl_platform_version",
    "opencl_vendor",
    "opencl_device",
    "opencl_driver",
    "opencl_version",
)

ANDROID_PROPERTIES = {
    "os_version": "ro.build.version.release",
    "manufacturer": "ro.product.manufacturer",
    "brand": "ro.product.brand",
    "model": "ro.product.model",
    "device": "ro.product.device",
    "board": "ro.product.board",
    "hardware": "ro.hardware",
    "soc_manufacturer": "ro.soc.manufacturer",
    "soc_model": "ro.soc.model",
    "board_platform": "ro.board.platform",
    "egl": "ro.hardware.egl",
}
GETPROP = "system/bin/getprop"  # its place when a terminal's PATH does not include it


def identify(
    root: Path = Path("/"), system: str = sys.platform, processor: Mapping[str, str | None] | None = None
) -> Identity:
    """All FIELDS of this device, null where unknown; `processor` adds those of the measuring device.

    `root` stands for the file system's root and `system` for sys.platform, so that tests can imitate any
    device.
    """
    if system == "darwin":
        fields = _macos()
    elif system == "win32":
        fields = _windows(_registry)
    else:
        fields = (_android(root) or _linux(root)) | _cpuinfo(root) | _sizes(root)
    fields.setdefault("cpu_count", line(os.cpu_count()))
    return dict.fromkeys(FIELDS) | {"architecture": line(platform.machine())} | fields | dict(processor or {})


def processor_identity(device: "Device") -> Identity:
    """The fields of `device` and its driver.

    Over WebGPU the same fields hold the adapter's name, its driver, and the interface below (Vulkan, Metal,
    Direct3D); an adapter has neither a vendor name nor an OpenCL version. Over WebAssembly the processor
    measures, which `cpu` names: these fields are unknown.
    """
    if device.backend == "wasm":
        return {}
    if device.backend == "opencl":
        return opencl_identity(device.handle)
    return {
        "opencl_platform": line(device.platform),
        "opencl_platform_version": line(device.version),
        "opencl_vendor": None,
        "opencl_device": line(device.name),
        "opencl_driver": line(device.driver),
        "opencl_version": None,
    }


def opencl_identity(device: Any) -> Identity:
    """The platform, device and driver strings of a `pyopencl.Device`."""
    return {
        "opencl_platform": line(device.platform.name),
        "opencl_platform_version": line(device.platform.version),
        "opencl_vendor": line(device.vendor),
        "opencl_device": line(device.name),
        "opencl_driver": line(device.driver_version),
        "opencl_version": line(device.version),
    }


def is_android(root: Path = Path("/")) -> bool:
    """Whether this is Android, in Termux."""
    return bool(_android(root))


def _android(root: Path) -> Identity:
    """The allowed system properties; empty without Android's getprop."""
    getprop = program("getprop", root, GETPROP)
    if getprop is None:
        return {}
    values = {field: line(output(getprop, key)) for field, key in ANDROID_PROPERTIES.items()}
    return {"os": "Android", **values} if any(values.values()) else {}


def _linux(root: Path) -> Identity:
    release = _assignments(read(root / "etc/os-release") or read(root / "usr/lib/os-release") or "")
    dmi = root / "sys/class/dmi/id"
    soc = root / "sys/devices/soc0"
    return {
        "os": line(release.get("NAME")) or "Linux",
        "os_version": line(release.get("VERSION_ID")),
        "manufacturer": line(read(dmi / "sys_vendor")),
        # A board without DMI, such as a Raspberry Pi, names itself in its device tree.
        "model": line(read(dmi / "product_name")) or line(read(root / "proc/device-tree/model")),
        "board": line(read(dmi / "board_name")),
        "soc_manufacturer": line(read(soc / "family")),
        "soc_model": line(read(soc / "machine")),
    }


def _cpuinfo(root: Path) -> Identity:
    """The processor's name, and the implementer and part codes of Arm cores, which often have no name."""
    names: list[str] = []
    parts: list[str] = []
    implementer = ""
    count = 0
    for text in (read(root / "proc/cpuinfo") or "").splitlines():
        key, _, value = (part.strip() for part in text.partition(":"))
        if key in ("model name", "Hardware", "Processor", "cpu model", "uarch"):
            names.append(value)
        elif key == "processor":
            count += 1
        elif key == "CPU implementer":
            implementer = value
        elif key == "CPU part":
            parts.append(f"{implementer}:{value}")
    return {
        "cpu": line(names[0] if names else None),
        "cpu_parts": line(" ".join(sorted(set(parts)))),
        "cpu_count": line(count or os.cpu_count()),
    }


def _sizes(root: Path) -> Identity:
    """The highest clock of each kind of core, and the memory in whole GiB: nominal values, not states."""
    cores = (root / "sys/devices/system/cpu").glob("cpu[0-9]*/cpufreq/cpuinfo_max_freq")
    clocks = sorted({round(kilohertz / 1000) for core in cores if (kilohertz := number(core))})
    total = _kilobytes(read(root / "proc/meminfo") or "", "MemTotal")
    return {
        "cpu_max_mhz": line(" ".join(map(str, clocks))),
        # The kernel reserves a part that varies by version: rounding up gives the nominal size.
        "memory_gib": line(math.ceil(total / 2**20)) if total else None,
    }


def _kilobytes(meminfo: str, name: str) -> int | None:
    for text in meminfo.splitlines():
        key, _, value = text.partition(":")
        if key == name and value.split()[:1] and value.split()[0].isdecimal():
            return int(value.split()[0])
    return None


def _macos() -> Identity:
    sysctl = program("sysctl")
    memory = line(output(sysctl, "-n", "hw.memsize"))
    return {
        "os": "macOS",
        "os_version": line(output(program("sw_vers"), "-productVersion")),
        "manufacturer": "Apple",
        "model": line(output(sysctl, "-n", "hw.model")),
        "cpu": line(output(sysctl, "-n", "machdep.cpu.brand_string")),
        "memory_gib": line(math.ceil(int(memory) / 2**30)) if memory and memory.isdecimal() else None,
    }


def _windows(value: Callable[[str, str], object]) -> Identity:
    """`value(key, name)` gives a value below HKEY_LOCAL_MACHINE, None where it is missing."""
    bios = r"HARDWARE\DESCRIPTION\System\BIOS"
    windows = r"SOFTWARE\Microsoft\Windows NT\CurrentVersion"
    return {
        "os": "Windows",
        "os_version": line(value(windows, "CurrentBuild")),
        "manufacturer": line(value(bios, "SystemManufacturer")),
        "model": line(value(bios, "SystemProductName")),
        "board": line(value(bios, "BaseBoardProduct")),
        "cpu": line(value(r"HARDWARE\DESCRIPTION\System\CentralProcessor\0", "ProcessorNameString")),
    }


def _registry(key: str, name: str) -> object:
    if sys.platform != "win32":
        return None
    import winreg

    try:
        with winreg.OpenKey(winreg.HKEY_LOCAL_MACHINE, key) as opened:
            return winreg.QueryValueEx(opened, name)[0]
    except OSError:
        return None


def _assignments(text: str) -> dict[str, str]:
    pairs = (part.partition("=") for part in text.splitlines())
    return {key: value.strip().strip("\"'") for key, _, value in pairs if key}
