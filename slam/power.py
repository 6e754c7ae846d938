"""Energy from the platform: processor counters (RAPL), INA sensors on boards, a phone's battery."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

SYSFS = Path("/sys")
LEAST_WATTS = (
    0.05  # of a running device; less is a gauge that counts in milliamperes, against the kernel's rule
)
SENSORS = re.compile(
    r"ina(2\d\d|3221)\w*"
)  # the drivers' names of INA219, INA226, INA238, INA260, INA3221 ...


@dataclass(frozen=True)
class EnergyReading:
    """Values at one moment: `seconds` of a clock, and microjoules of each counter or watts of each sensor.

    `values` is None where one of them could not be read.
    """

    seconds: float
    values: tuple[float, ...] | None


class EnergyMeter:
    """The first of these that the platform has; never a sum, since they overlap:

    - "rapl": all processor packages (cores, caches, integrated graphics; neither memory nor screen), from
      counters of energy. Since 2020 Linux shows them to root only;
    - "ina": the rails that INA2xx and INA3221 sensors watch, as on Odroid and Jetson boards; where one is the
      board's input (its label ends in _IN), that one alone, of which the others are parts;
    - "battery": the whole device with its screen, while it runs from its battery. The gauge is updated a few
      times a second at best, so it is only useful for runs of many seconds.

    `source` is one of these names or None. The last two show power: energy is the mean of the power at both
    readings times the seconds between them. `root` is where sysfs is found.
    """

    def __init__(self, root: Path = SYSFS) -> None:
        self.source: str | None = None
        self._counters = _rapl_counters(root / "class/powercap")
        self._sensors: list[Callable[[], float]] = []
        if self._counters:
            self.source = "rapl"
            return
        for source, sensors in (
            ("ina", _ina_sensors(root / "class/hwmon")),
            ("battery", _batteries(root / "class/power_supply")),
        ):
            if sensors:
                self.source, self._sensors = source, sensors
                return

    @property
    def available(self) -> bool:
        return self.source is not None

    def read(self) -> EnergyReading:
        """The present values."""
        readers = [_counter(path) for path, _ in self._counters] or self._sensors
        try:
            return EnergyReading(perf_counter(), tuple(reader() for reader in readers))
        except (OSError, ValueError):  # a sensor that went away, a charger that came
            return EnergyReading(perf_counter(), None)

    def joules(self, before: EnergyReading, after: EnergyReading) -> float | None:
        """Energy between two readings, or None where it is not known. A counter may have wrapped once."""
        if before.values is None or after.values is None or self.source is None:
            return None
        if self.source != "rapl":
            return sum(before.values + after.values) / 2 * (after.seconds - before.seconds)
        used = 0.0
        for first, last, (_, limit) in zip(before.values, after.values, self._counters, strict=True):
            used += last - first if last >= first else last - first + limit
        return used * 1e-6


def _number(path: Path) -> float:
    return float(int(path.read_text()))


def _readable(sensor: Callable[[], float]) -> bool:
    try:
        sensor()
    except (OSError, ValueError):  # hidden from this user, switched off, or not a number
        return False
    return True


def _rapl_counters(folder: Path) -> list[tuple[Path, float]]:
    """Each package's counter and the value after which it starts from zero; cores are a part of it."""
    counters = []
    for package in sorted(folder.glob("intel-rapl:*")):
        if re.fullmatch(r"intel-rapl:\d+", package.name) and _readable(_counter(package / "energy_uj")):
            limit = package / "max_energy_range_uj"
            if _readable(_counter(limit)):
                counters.append((package / "energy_uj", _number(limit)))
    return counters


def _ina_sensors(folder: Path) -> list[Callable[[], float]]:
    """Watts of every rail: its power in microwatts, else its current (mA) times its voltage (mV)."""
    inputs: list[Callable[[], float]] = []
    rails: list[Callable[[], float]] = []
    for chip in sorted(folder.glob("hwmon*")):
        if not SENSORS.fullmatch(_text(chip / "name")):
            continue
        # An INA3221 shows currents 1 to 3, their buses as in1 to in3, and beyond these only sums and shunts.
        for number in "123":
            sensor = _counter(chip / f"power{number}_input", 1e-6)
            if not _readable(sensor):
                sensor = _product(chip / f"curr{number}_input", chip / f"in{number}_input", 1e-6)
            if _readable(sensor):
                board = _text(chip / f"in{number}_label").upper().endswith("_IN")
                (inputs if board else rails).append(sensor)
    return inputs or rails


def _batteries(folder: Path) -> list[Callable[[], float]]:
    """Watts drawn from every battery (microamperes times microvolts)."""
    sensors: list[Callable[[], float]] = []
    for supply in sorted(folder.glob("*")):
        sensor = _discharging(supply)
        if _text(supply / "type") == "Battery" and _readable(sensor):
            sensors.append(sensor)
    return sensors


def _text(path: Path) -> str:
    try:
        return path.read_text().strip()
    except OSError:
        return ""


def _counter(path: Path, unit: float = 1.0) -> Callable[[], float]:
    return lambda: _number(path) * unit


def _product(first: Path, second: Path, unit: float) -> Callable[[], float]:
    return lambda: _number(first) * _number(second) * unit


def _discharging(supply: Path) -> Callable[[], float]:
    """Watts of a battery; ValueError while it does not supply the device."""

    def watts() -> float:
        status = (supply / "status").read_text().strip()
        # The current is negative on some devices while discharging.
        power = abs(_number(supply / "current_now")) * _number(supply / "voltage_now") * 1e-12
        if status != "Discharging" or power < LEAST_WATTS:
            raise ValueError(f"{supply.name} is {status or 'silent'} and gives {power} W")
        return power

    return watts
