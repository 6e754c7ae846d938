"""Temperature, clock and battery while a measurement runs; null where the platform hides them."""

import re
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from client_kit.device.sources import number, word
from wire.session import Sample

PLAUSIBLE_CELSIUS = (-40.0, 150.0)
# Qualcomm's kernels have zones for the battery's charge (soc, percent), voltage and current, which are not
# temperatures.
NO_TEMPERATURE = re.compile(r"soc$|.*(vbat|ibat|bcl)", re.IGNORECASE)
LOW_POLICY = "low_limits"
INTERVAL_SECONDS = 1.0
LOW_BATTERY_PERCENT = 20.0


@dataclass(frozen=True)
class Battery:
    """Charge in percent, and whether it is discharging; None where unknown."""

    percent: float
    discharging: bool | None

    @property
    def low(self) -> bool:
        """Whether a measurement might be throttled, or empty the battery."""
        return self.percent < LOW_BATTERY_PERCENT and self.discharging is not False


def temperature(root: Path = Path("/")) -> float | None:
    """The hottest plausible thermal zone, in degrees Celsius.

    The zones' names differ from maker to maker; the throttling policy acts on the hottest one.
    """
    zones = (
        number(zone / "temp")
        for zone in (root / "sys/class/thermal").glob("thermal_zone*")
        if not NO_TEMPERATURE.match(word(zone / "type") or "")
        and not (word(zone / "policy") or "").startswith(LOW_POLICY)
    )
    low, high = PLAUSIBLE_CELSIUS
    # Most kernels report thousandths of a degree, some old ones whole degrees.
    degrees = [value / 1000 if abs(value) > high else value for value in zones if value is not None]
    return max((value for value in degrees if low < value < high and value != 0), default=None)


def clock(root: Path = Path("/")) -> float | None:
    """The fastest core's current clock in MHz: the measured thread probably runs on it."""
    pattern = "cpu[0-9]*/cpufreq/scaling_cur_freq"
    kilohertz = [number(path) for path in (root / "sys/devices/system/cpu").glob(pattern)]
    megahertz = [value / 1000 for value in kilohertz if value]
    return max(megahertz, default=None)


def battery(root: Path = Path("/")) -> Battery | None:
    """The device's battery, not that of a mouse or a pen; None on a machine without one."""
    for supply in sorted((root / "sys/class/power_supply").glob("*")):
        if word(supply / "type") != "Battery" or word(supply / "scope") == "Device":
            continue
        percent = number(supply / "capacity")
        if percent is not None and 0 <= percent <= 100:
            status = word(supply / "status")
            return Battery(percent, None if status in (None, "Unknown") else status == "Discharging")
    return None


@dataclass
class Sampler:
    """Readings at most once a second, taken between frames, outside of the measured time."""

    root: Path = Path("/")
    now: Callable[[], float] = time.monotonic
    samples: list[Sample] = field(default_factory=list)
    _started: float | None = None
    _last: float = 0.0

    def sample(self) -> None:
        """Read the sensors, unless that was done less than a second ago."""
        now = self.now()
        if self._started is None:
            self._started = now
        elif now - self._last < INTERVAL_SECONDS:
            return
        self._last = now
        charge = battery(self.root)
        seconds, percent = round(now - self._started, 3), charge.percent if charge else None
        self.samples.append(Sample(seconds, temperature(self.root), clock(self.root), percent))
