"""What a device says of itself: raw strings, null where it says nothing, never who owns it.

Only the sources named here are read. Serial numbers, network addresses, host and user names are in none of
them; the server decides what the strings mean, so that a wrong guess can be put right later.
"""

import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

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
    "soc_manufacturer",
    "soc_model",
    "board_platform",
    "egl",
    "cpu",
    "cpu_parts",
    "cpu_count",
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
    "soc_manufacturer": "ro.soc.manufacturer",
    "soc_model": "ro.soc.model",
    "board_platform": "ro.board.platform",
    "egl": "ro.hardware.egl",
}

LONGEST = 200
PATIENCE_SECONDS = 5.0


def identify(
    root: Path = Path("/"), system: str = sys.platform, opencl: Mapping[str, str | None] | None = None
) -> Identity:
    """All FIELDS of this device, null where unknown; `opencl` adds those of the OpenCL device in use.

    `root` stands for the file system's root and `system` for sys.platform, so that any device can be played.
    """
    if system == "darwin":
        found = _macos()
    elif system == "win32":
        found = _windows(_registry)
    else:
        found = _android() or _linux(root)
        found |= _cpuinfo(root)
    found.setdefault("cpu_count", _text(os.cpu_count()))
    return dict.fromkeys(FIELDS) | {"architecture": _text(platform.machine())} | found | dict(opencl or {})


def opencl_identity(device: Any) -> Identity:
    """The platform, device and driver strings of a `pyopencl.Device`."""
    return {
        "opencl_platform": _text(device.platform.name),
        "opencl_platform_version": _text(device.platform.version),
        "opencl_vendor": _text(device.vendor),
        "opencl_device": _text(device.name),
        "opencl_driver": _text(device.driver_version),
        "opencl_version": _text(device.version),
    }


def _android() -> Identity:
    """The allowed system properties, or nothing where there is no Android's getprop."""
    getprop = shutil.which("getprop")
    if getprop is None:
        return {}
    values = {field: _text(_output(getprop, key)) for field, key in ANDROID_PROPERTIES.items()}
    return {"os": "Android", **values} if any(values.values()) else {}


def _linux(root: Path) -> Identity:
    release = _assignments(_read(root / "etc/os-release") or _read(root / "usr/lib/os-release") or "")
    dmi = root / "sys/class/dmi/id"
    soc = root / "sys/devices/soc0"
    return {
        "os": _text(release.get("NAME")) or "Linux",
        "os_version": _text(release.get("VERSION_ID")),
        "manufacturer": _text(_read(dmi / "sys_vendor")),
        # A board without DMI, such as a Raspberry Pi, names itself in its device tree.
        "model": _text(_read(dmi / "product_name")) or _text(_read(root / "proc/device-tree/model")),
        "board": _text(_read(dmi / "board_name")),
        "soc_manufacturer": _text(_read(soc / "family")),
        "soc_model": _text(_read(soc / "machine")),
    }


def _cpuinfo(root: Path) -> Identity:
    """The processor's name, and the implementer and part codes of Arm cores, which often have no name."""
    names: list[str] = []
    parts: list[str] = []
    implementer = ""
    count = 0
    for line in (_read(root / "proc/cpuinfo") or "").splitlines():
        key, _, value = (part.strip() for part in line.partition(":"))
        if key in ("model name", "Hardware", "Processor", "cpu model", "uarch"):
            names.append(value)
        elif key == "processor":
            count += 1
        elif key == "CPU implementer":
            implementer = value
        elif key == "CPU part":
            parts.append(f"{implementer}:{value}")
    return {
        "cpu": _text(names[0] if names else None),
        "cpu_parts": _text(" ".join(sorted(set(parts)))),
        "cpu_count": _text(count or os.cpu_count()),
    }


def _macos() -> Identity:
    sysctl, sw_vers = shutil.which("sysctl"), shutil.which("sw_vers")
    return {
        "os": "macOS",
        "os_version": _text(_output(sw_vers, "-productVersion")),
        "manufacturer": "Apple",
        "model": _text(_output(sysctl, "-n", "hw.model")),
        "cpu": _text(_output(sysctl, "-n", "machdep.cpu.brand_string")),
    }


def _windows(read: Callable[[str, str], object]) -> Identity:
    """`read(key, name)` gives a value below HKEY_LOCAL_MACHINE, None where it is missing."""
    bios = r"HARDWARE\DESCRIPTION\System\BIOS"
    windows = r"SOFTWARE\Microsoft\Windows NT\CurrentVersion"
    return {
        "os": "Windows",
        "os_version": _text(read(windows, "CurrentBuild")),
        "manufacturer": _text(read(bios, "SystemManufacturer")),
        "model": _text(read(bios, "SystemProductName")),
        "board": _text(read(bios, "BaseBoardProduct")),
        "cpu": _text(read(r"HARDWARE\DESCRIPTION\System\CentralProcessor\0", "ProcessorNameString")),
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


def _output(program: str | None, *arguments: str) -> str | None:
    """What the program prints; None where it is missing, fails or does not come back in time."""
    if program is None:
        return None
    try:
        done = subprocess.run(
            [program, *arguments],
            capture_output=True,
            timeout=PATIENCE_SECONDS,
            check=True,
            stdin=subprocess.DEVNULL,
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.decode("utf-8", "replace")


def _read(path: Path) -> str | None:
    """A small file's text; None where it is missing or, as on many phones, hidden."""
    try:
        return path.read_bytes()[:1_000_000].decode("utf-8", "replace")
    except OSError:
        return None


def _assignments(text: str) -> dict[str, str]:
    pairs = (line.partition("=") for line in text.splitlines())
    return {key: value.strip().strip("\"'") for key, _, value in pairs if key}


def _text(value: object) -> str | None:
    """One printable line of at most LONGEST characters, None when nothing is left of it."""
    if value is None:
        return None
    line = " ".join("".join(c if c.isprintable() else " " for c in str(value)).split())
    return line[:LONGEST] or None
