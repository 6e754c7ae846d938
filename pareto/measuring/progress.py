"""Progress of an exploration: one line rewritten in place on a terminal, an occasional line elsewhere."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import TextIO

import numpy as np
from numpy.typing import NDArray

from pareto.fronts.front import nondominated
from pareto.fronts.hypervolume import FIRST, hypervolume, reference_point
from pareto.measuring.folder import made_here
from pareto.search.explorer import Explorer

ON_TERMINAL, ELSEWHERE = 0.1, 10.0  # seconds between two lines, at least


class Progress:
    """Prints the numbers of measurements and failures, size and hypervolume of the front, and the time left.

    The time left is the average time of a measurement since the start, including proposals, times the missing
    ones; at most until the `deadline`, in seconds since 1970.
    """

    def __init__(
        self,
        explorer: Explorer,
        budget: int,
        stream: TextIO,
        clock: Callable[[], float] = time.monotonic,
        deadline: float = np.inf,
    ) -> None:
        self.explorer, self.budget, self.stream, self.clock = explorer, budget, stream, clock
        self.deadline = deadline
        self.live = stream.isatty()
        self._begun = clock()
        self._before = made_here(explorer)
        self._last_written = -np.inf

    def update(self, done: int) -> None:
        """Write a line after `done` measurements, at most one every few seconds, and always the last."""
        now = self.clock()
        if done < self.budget and now - self._last_written < (ON_TERMINAL if self.live else ELSEWHERE):
            return
        self._last_written = now
        mean = (now - self._begun) / max(done - self._before, 1)
        left = min(mean * (self.budget - done), max(self.deadline - time.time(), 0))
        line = describe(self.explorer, self.budget, left)
        if self.live:  # a longer line would wrap, and the next one would not cover it
            width = shutil.get_terminal_size().columns - 1
            line = f"\r{line[:width]:<{width}}"
        self._write(line if self.live else f"{line}\n")

    def say(self, message: str) -> None:
        """Write a message on a line of its own."""
        self.end()
        self._write(f"frontrunner: {message}\n")

    def end(self) -> None:
        """Finish the line and continue below it."""
        if self.live and np.isfinite(self._last_written):
            self._write("\n")
            self._last_written = -np.inf

    def _write(self, text: str) -> None:
        with suppress(OSError):  # a terminal that was closed costs no measurement
            self.stream.write(text)
            self.stream.flush()


def describe(explorer: Explorer, budget: int, left: float) -> str:
    """Return the line; `left` are seconds."""
    parts = [f"{made_here(explorer)}/{budget} measured"]
    if failed := len(explorer.history.failed()):
        parts.append(f"{failed} failed")
    if ended := len(explorer.history.exact()) - explorer.history.exact().sum():
        parts.append(f"{ended} ended early")
    front = summarise_front(explorer, explorer.history.measured()[1])
    parts += [f"{front.size} on the front", f"{duration(left)} left"]
    if explorer.history.exact().sum() >= FIRST:  # before, its reference may move
        parts.append(front.describe())
    return ", ".join(parts)


@dataclass(frozen=True)
class FrontSummary:
    """The size of a front and its hypervolume up to the `reference` point, by the objectives' names.

    With `log` the volume is that of the values' logarithms.
    """

    size: int
    volume: float
    reference: dict[str, float]
    log: bool = False

    def describe(self) -> str:
        """Return the hypervolume with its reference point, as text."""
        point = ", ".join(f"{name} {value:.4g}" for name, value in self.reference.items())
        kind = " of logarithms" if self.log else ""
        return f"hypervolume {self.volume:.4g}{kind} up to {point}" if point else "hypervolume 0"


def summarise_front(explorer: Explorer, values: NDArray[np.float64]) -> FrontSummary:
    """Return size and hypervolume of the front of the explorer's (n, objectives) values.

    The volume ends at the limits, or at the worst value of the FIRST configurations where there is none. It
    is of logarithms where all values are positive. Configurations with a censored value do not count. Of
    measured values it is the last one of `hypervolume_growth`.
    """
    exact = explorer.history.exact()
    values = values[exact]
    if len(values) == 0:
        return FrontSummary(0, 0.0, {})
    maximise = [objective.maximise for objective in explorer.objectives]
    limits = [explorer.limits.get(objective.name) for objective in explorer.objectives]
    # The first measurement of each: repeats do not move the reference.
    first = [next(filter(None, rows)) for rows in explorer.history.results.values() if any(rows)]
    reference = reference_point(np.array(first)[exact], limits, maximise)
    log = bool(values.min() > 0 and reference.min() > 0)
    values = values[explorer.history.within_limits(values)]
    front = values[nondominated(values, maximise)]
    names = [objective.name for objective in explorer.objectives]
    return FrontSummary(
        len(front),
        hypervolume(front, reference, maximise, log),
        dict(zip(names, reference.tolist(), strict=True)),
        log,
    )


def duration(seconds: float) -> str:
    """Return a time as 42 s, 12:05 min or 3:25 h."""
    whole = round(seconds)
    if whole < 100:
        return f"{whole} s"
    if whole < 6000:
        return f"{whole // 60}:{whole % 60:02} min"
    return f"{whole // 3600}:{whole % 3600 // 60:02} h"
