"""Several measurements at once, each in a thread with resources of its own."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from pareto.errors import EvaluationError
from pareto.search.stopping import Condition
from pareto.spaces.space import Configuration

Resources = Mapping[str, str]
Conditions = Sequence[Condition]
Measure = Callable[[Configuration, Resources, Conditions], dict[str, float]]


@dataclass(frozen=True)
class Finished:
    """A measurement that has ended: its values, or why it failed, and the seconds that it took."""

    configuration: Configuration
    values: dict[str, float] | None
    seconds: float
    failure: EvaluationError | None = None


class Pool:
    """Measures at most one configuration in each of `slots`, which hold the resources of one measurement."""

    def __init__(self, measure: Measure, slots: Sequence[Resources] = ({},)) -> None:
        self._measure = measure
        self._free = list(reversed(slots))
        self._threads: dict[threading.Thread, Resources] = {}
        self._results: deque[tuple[threading.Thread, Finished | BaseException]] = deque()
        self._changed = threading.Event()
        self._ending = False

    @property
    def free(self) -> int:
        """The number of free slots."""
        return len(self._free)

    @property
    def running(self) -> int:
        """The number of measurements started and not yet taken."""
        return len(self._threads)

    def start(self, configuration: Configuration, conditions: Conditions = ()) -> None:
        """Start a measurement in a free slot, which may end early under these conditions."""
        slot = self._free.pop()
        thread = threading.Thread(target=self._work, args=(configuration, slot, conditions), daemon=True)
        self._threads[thread] = slot
        thread.start()

    def wait(self) -> None:
        """Wait until a measurement has finished. An interrupt here loses nothing."""
        self._changed.wait()

    def take(self) -> list[Finished]:
        """Return the finished measurements, in that order, and free their slots.

        Raises the error that ended a measurement, unless it is an EvaluationError.
        """
        self._changed.clear()
        taken = []
        while self._results:
            thread, result = self._results.popleft()
            self._free.append(self._threads.pop(thread))
            if isinstance(result, BaseException):
                raise result
            taken.append(result)
        return taken

    def end(self, kill: Callable[[], None]) -> list[Finished]:
        """End all measurements by `kill`; return those that had finished before."""
        self._ending = True
        kill()
        for thread in list(self._threads):
            thread.join(10)
        return [item for _, item in self._results if isinstance(item, Finished)]

    def _work(self, configuration: Configuration, slot: Resources, conditions: Conditions) -> None:
        started = time.monotonic()
        result: Finished | BaseException
        try:
            values = self._measure(configuration, slot, conditions)
            result = Finished(configuration, values, time.monotonic() - started)
        except EvaluationError as failure:
            if self._ending:
                return
            result = Finished(configuration, None, time.monotonic() - started, failure)
        except BaseException as error:
            result = error
        self._results.append((threading.current_thread(), result))
        self._changed.set()
