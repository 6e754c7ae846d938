"""Energy from the processor's own counters (RAPL), where the operating system shows them."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

POWERCAP = Path("/sys/class/powercap")


@dataclass(frozen=True)
class EnergyReading:
    """Counter values in microjoules, one for each package."""

    microjoules: tuple[int, ...]


class EnergyMeter:
    """The energy of all processor packages: cores, caches and integrated graphics, not memory or screen.

    `available` is False where there are no counters (virtual machines, phones, macOS, Windows) or where they
    may not be read: since 2020 Linux shows them to root only.
    """

    def __init__(self, root: Path = POWERCAP) -> None:
        packages = [path for path in root.glob("intel-rapl:*") if re.fullmatch(r"intel-rapl:\d+", path.name)]
        self._counters: list[tuple[Path, int]] = []
        for package in sorted(packages):
            try:
                int((package / "energy_uj").read_text())
                limit = int((package / "max_energy_range_uj").read_text())
            except (OSError, ValueError):  # hidden from this user, or no counter
                continue
            self._counters.append((package / "energy_uj", limit))

    @property
    def available(self) -> bool:
        return bool(self._counters)

    def read(self) -> EnergyReading:
        return EnergyReading(tuple(int(path.read_text()) for path, _ in self._counters))

    def joules(self, before: EnergyReading, after: EnergyReading) -> float:
        """Energy between two readings, joules. A counter may have wrapped once in between."""
        used = 0
        for first, last, (_, limit) in zip(
            before.microjoules, after.microjoules, self._counters, strict=True
        ):
            used += last - first if last >= first else last - first + limit
        return used * 1e-6
