"""The state a device is in before it measures: charge, power saving, throttling, load, free memory and disk.

Every function returns None where the platform does not report the value. Nothing here is sent; it decides
whether a measurement would be representative of the device.
"""

import ctypes
import json
import os
import re
import shutil
import sys
from pathlib import Path

from client_kit.device import sensors
from client_kit.device.sensors import Battery
from client_kit.device.sources import number, output, program, read, word

# Governors that limit the clock. `powersave` is the usual setting of drivers that choose clocks themselves;
# it limits the clock only with other drivers.
SAVING_PROFILES = ("low-power", "quiet")
OWN_CLOCKS = ("intel_pstate", "amd-pstate", "amd-pstate-epp")
COOLERS = re.compile(r"processor|cpufreq|cpu|gpu|devfreq", re.IGNORECASE)
MAC_SPEED_LIMIT = re.compile(r"CPU_Speed_Limit\s*=\s*(\d+)")
MAC_CHARGE = re.compile(r"(\d+)%;\s*([a-z ]+)")


def battery(root: Path = Path("/"), system: str = sys.platform) -> Battery | None:
    """The device's own battery: from sysfs, else from Termux:API, macOS or Windows."""
    if system == "darwin":
        match = MAC_CHARGE.search(output(program("pmset"), "-g", "batt") or "")
        return Battery(float(match[1]), match[2].strip() == "discharging") if match else None
    if system == "win32":
        status = _windows_power()
        if status is None or status[1] > 100:
            return None
        return Battery(float(status[1]), status[0] == 0)
    return sensors.battery(root) or _termux_battery()


def power_saving(root: Path = Path("/"), system: str = sys.platform) -> bool | None:
    """Whether the user or the system limits clocks to save power."""
    if system == "darwin":
        match = re.search(r"lowpowermode\s+(\d)", output(program("pmset"), "-g") or "")
        return match[1] == "1" if match else None
    if system == "win32":
        status = _windows_power()
        return None if status is None else status[2] == 1
    low_power = (output(program("settings"), "get", "global", "low_power") or "").strip()
    if low_power in ("0", "1"):
        return low_power == "1"
    profile = word(root / "sys/firmware/acpi/platform_profile")
    if profile is not None:
        return profile in SAVING_PROFILES
    clock = root / "sys/devices/system/cpu/cpu0/cpufreq"
    governor, driver = word(clock / "scaling_governor"), word(clock / "scaling_driver")
    if governor is None:
        return None
    return governor == "powersave" and driver not in OWN_CLOCKS


def throttling(root: Path = Path("/"), system: str = sys.platform) -> str | None:
    """The platform's report of thermal throttling, or None.

    Thermal zones are not used: on phones many of them are voltages or percentages, and on PCs their passive
    trips depend on the last notification of a program.
    """
    if system == "darwin":
        limit = MAC_SPEED_LIMIT.search(output(program("pmset"), "-g", "therm") or "")
        return f"the processor is held to {limit[1]} %" if limit and int(limit[1]) < 100 else None
    for device in sorted((root / "sys/class/thermal").glob("cooling_device*")):
        kind, state = word(device / "type"), number(device / "cur_state")
        if kind and COOLERS.search(kind) and state and state > 0:
            return f"{kind} is slowed down (step {state:.0f})"
    return None


def load(root: Path = Path("/"), system: str = sys.platform) -> float | None:
    """The number of busy processors, averaged over the last minute."""
    if system.startswith(("linux", "android")):
        fields = (read(root / "proc/loadavg") or "").split()
        return float(fields[0]) if fields else None
    try:
        return os.getloadavg()[0]
    except (AttributeError, OSError):  # not on Windows
        return None


def free_memory(root: Path = Path("/")) -> int | None:
    """Bytes that programs can still allocate without the system ending others; Linux and Android only."""
    match = re.search(r"^MemAvailable:\s+(\d+) kB", read(root / "proc/meminfo") or "", re.MULTILINE)
    return int(match[1]) * 1024 if match else None


def free_disk(folder: Path) -> int | None:
    """Bytes that this user may still write in `folder`'s file system."""
    try:
        return shutil.disk_usage(folder).free
    except OSError:
        return None


def _termux_battery() -> Battery | None:
    """Android hides the battery's files from apps; the package termux-api asks the system."""
    try:
        status = json.loads(output(program("termux-battery-status")) or "null")
        return Battery(float(status["percentage"]), status["status"] == "DISCHARGING")
    except (ValueError, TypeError, KeyError):
        return None


def _windows_power() -> tuple[int, int, int] | None:
    """ACLineStatus, BatteryLifePercent and SystemStatusFlag of Windows' GetSystemPowerStatus."""
    if sys.platform != "win32":
        return None
    status = (ctypes.c_ubyte * 12)()
    if not ctypes.windll.kernel32.GetSystemPowerStatus(ctypes.byref(status)):
        return None
    return status[0], status[2], status[3]
