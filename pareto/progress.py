"""How far an exploration is: one line that is written over on a terminal, now and then a line elsewhere."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TextIO

import numpy as np

from pareto.explorer import Explorer
from pareto.folder import made_here
from pareto.front import nondominated
from pareto.hypervolume import hypervolume, reference_point

ON_TERMINAL, ELSEWHERE = 0.1, 10.0  # seconds between two lines, at least


class Progress:
    """Tells how many were measured and failed, size and hypervolume of the front, and the time left.

    The time left is what the measurements since the start took on average, asking included, times those
    missing.
    """

    def __init__(
        self,
        explorer: Explorer,
        budget: int,
        stream: TextIO,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.explorer, self.budget, self.stream, self.clock = explorer, budget, stream, clock
        self.live = stream.isatty()
        self._begun = clock()
        self._before = made_here(explorer)
        self._told = -np.inf

    def tell(self, done: int) -> None:
        """Write a line after `done` measurements, unless the last one is fresh. The last is always told."""
        now = self.clock()
        if done < self.budget and now - self._told < (ON_TERMINAL if self.live else ELSEWHERE):
            return
        self._told = now
        mean = (now - self._begun) / max(done - self._before, 1)
        line = describe(self.explorer, self.budget, mean * (self.budget - done))
        self.stream.write(f"\r{line:<78}" if self.live else f"{line}\n")
        self.stream.flush()

    def end(self) -> None:
        """Leave the line as it is and go on below it."""
        if self.live and np.isfinite(self._told):
            self.stream.write("\n")


def describe(explorer: Explorer, budget: int, left: float) -> str:
    """Return the line; `left` are seconds. The hypervolume is of logarithms where all values are positive."""
    parts = [f"{made_here(explorer)}/{budget} measured"]
    if failed := len(explorer.history.failed()):
        parts.append(f"{failed} failed")
    front, volume = present_front(explorer)
    parts.append(f"{front} on the front")
    parts.append(f"hypervolume {volume:.4g}")
    parts.append(f"{duration(left)} left")
    return ", ".join(parts)


def present_front(explorer: Explorer) -> tuple[int, float]:
    """Return the front's size, and its hypervolume up to the limits, or the worst value where there is none.

    The volume is the last value of `hypervolume_growth` over the same measurements.
    """
    _, values = explorer.history.measured()
    if len(values) == 0:
        return 0, 0.0
    maximise = [objective.maximise for objective in explorer.objectives]
    limits = [explorer.limits.get(objective.name) for objective in explorer.objectives]
    reference = reference_point(values, limits, maximise)
    log = bool(values.min() > 0 and reference.min() > 0)
    values = values[explorer.history.within_limits(values)]
    front = values[nondominated(values, maximise)]
    return len(front), hypervolume(front, reference, maximise, log)


def duration(seconds: float) -> str:
    """Return a time as 42 s, 12:05 min or 3:25 h."""
    whole = round(seconds)
    if whole < 100:
        return f"{whole} s"
    if whole < 6000:
        return f"{whole // 60}:{whole % 60:02} min"
    return f"{whole // 3600}:{whole % 3600 // 60:02} h"
