"""The processor time of this process's threads, and how long they stood ready without a processor."""

import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

THREADS = Path("/proc/self/task")
# Windows counts processor time in steps of 15.6 ms: shorter sums say little.
LEAST_SECONDS_ON_WINDOWS = 0.5
MICROSECONDS, NANOSECONDS = 1e6, 1e9  # a second


class Used(NamedTuple):
    """Microseconds of the processor over all threads, and of waiting for one; None where unknown."""

    cpu_us: int | None
    waited_us: int | None


class ProcessorClock:
    """Measures from `start` to `stop`. Threads that end in between are missed; those of drivers stay."""

    def __init__(self, threads: Path = THREADS) -> None:
        self._threads = threads
        self.start()

    def start(self) -> None:
        self._cpu, self._waited = time.process_time(), self._waiting()

    def stop(self) -> Used:
        """The time since the start."""
        cpu, waited = time.process_time() - self._cpu, self._waiting()
        coarse = sys.platform == "win32" and cpu < LEAST_SECONDS_ON_WINDOWS
        waiting = None if waited is None or self._waited is None else max(waited - self._waited, 0.0)
        return Used(
            None if coarse else round(cpu * MICROSECONDS),
            None if waiting is None else round(waiting * MICROSECONDS),
        )

    def _waiting(self) -> float | None:
        """Seconds that all threads stood ready without a processor; None where Linux does not count."""
        counted = list(self._counters())
        return sum(counted) / NANOSECONDS if counted else None

    def _counters(self) -> Iterator[int]:
        for path in self._threads.glob("*/schedstat"):
            try:
                # Time on a processor, time ready without one, number of time slices.
                _, waited, _ = path.read_text().split()
            except (OSError, ValueError):  # the thread has ended
                continue
            yield int(waited)
