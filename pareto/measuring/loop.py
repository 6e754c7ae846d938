"""The measurement loop: ask, measure, save, tell, until the budget is spent or stopping early is better."""

from __future__ import annotations

import math
import re
import sys
import time
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass
from itertools import chain

from pareto.errors import InfeasibleError
from pareto.fronts.censored import Censored
from pareto.measuring.folder import IMPORTED, Folder, made_here
from pareto.measuring.interrupts import Interrupts, interruptible
from pareto.measuring.pool import Finished, Pool
from pareto.measuring.progress import Progress
from pareto.search.answer import ENOUGH, constant_objectives
from pareto.search.explorer import Explorer
from pareto.spaces.space import Configuration


@dataclass(frozen=True)
class Plan:
    """The plan: `budget` measurements in the folder, in batches of `batch` proposals.

    Each configuration is measured `repeats` times. So many equal failures at the start as `give_up` end the
    search; 0 for never. After the `deadline`, in seconds since 1970, no measurement starts.
    """

    budget: int
    batch: int
    repeats: int = 1
    give_up: int = 0
    deadline: float = math.inf


class MeasurementLoop:
    """Measures an explorer's proposals in the slots of a pool, and saves them in a folder.

    `end` kills running programs. `refresh` is called before each batch. `reasons` counts the failures of this
    call; `stopped`: why the search gave up; `late`: whether the deadline ended it.
    """

    def __init__(
        self,
        explorer: Explorer,
        folder: Folder,
        pool: Pool,
        plan: Plan,
        end: Callable[[], None] = lambda: None,
        refresh: Callable[[], None] = lambda: None,
    ) -> None:
        self.explorer, self.folder, self.pool, self.plan = explorer, folder, pool, plan
        self.reasons: Counter[str] = Counter()
        self.stopped = ""
        self.late = False
        self._end, self._refresh = end, refresh
        self._done = made_here(explorer)
        self._queue = deque(self._unfinished())
        self._progress = Progress(explorer, plan.budget, sys.stderr, deadline=plan.deadline)
        self._alike: Counter[str] = Counter()
        self._finished = 0  # in this call
        self._looked_for_constants = False

    def run(self) -> None:
        """Measure. On an interrupt all programs end, and KeyboardInterrupt reports the progress."""
        with interruptible() as interrupts:
            try:
                while self._fill(interrupts):
                    self.pool.wait()
                    with interrupts.held():  # finished measurements are saved first
                        for finished in self.pool.take():
                            self._take(finished)
                    if self.stopped:
                        break
                self._end_running()
                self.folder.asked(self.explorer)
            except KeyboardInterrupt:
                interrupts.ignore()
                self._end_running()
                self._progress.end()
                self.folder.write_front(self.explorer)
                raise KeyboardInterrupt(
                    f"interrupted after {made_here(self.explorer)} of {self.plan.budget} measurements, all "
                    f"of them saved in {self.folder.path}; the same command goes on from there"
                ) from None
            finally:
                self._end()  # also where an error ends the search
        self._progress.end()

    def _unfinished(self) -> list[Configuration]:
        """Return the unfinished proposals of an earlier call, in its order."""
        explorer, history = self.explorer, self.explorer.history
        counts = {
            index: len(values)
            for index, values in history.results.items()
            if history.phases[index] != IMPORTED and None not in values
        } | dict.fromkeys(history.waiting(), 0)
        further = ((index for index in counts if counts[index] < n) for n in range(2, self.plan.repeats + 1))
        return [*explorer.pending(), *map(explorer.space.decode, chain.from_iterable(further))]

    def _fill(self, interrupts: Interrupts) -> bool:
        """Start measurements in free slots; return whether any is running."""
        while self.pool.free and self._done + self.pool.running < self.plan.budget:
            self.late = time.time() >= self.plan.deadline
            if self.late:  # running programs are let to finish: their measurements are nearly paid for
                break
            if not self._queue and not self._ask():
                break
            with interrupts.held():
                configuration = self._queue.popleft()
                if self._ended_badly(configuration):
                    self.explorer.forget([configuration])
                else:
                    self.pool.start(configuration, self.explorer.stop_conditions(configuration))
        return self.pool.running > 0

    def _ask(self) -> bool:
        """Ask for a batch and queue it, once a repeat: a configuration comes again after all others."""
        self._refresh()
        left = self.plan.budget - self._done - self.pool.running
        batch = self.explorer.ask(min(self.plan.batch, -(-left // self.plan.repeats)))
        if batch:
            self.folder.asked(self.explorer)
            if self.plan.repeats > 1:  # those that are proposed twice are measured again in any case
                batch = list({self.explorer.space.encode(item): item for item in batch}.values())
            self._queue.extend(batch * self.plan.repeats)
        return bool(batch)

    def _ended_badly(self, configuration: Configuration) -> bool:
        """Return whether a measurement of it failed or ended early in this folder: neither is repeated."""
        index = self.explorer.space.encode(configuration)
        results = self.explorer.history.results.get(index, [])
        return any(values is None or any(isinstance(v, Censored) for v in values) for values in results)

    def _take(self, finished: Finished) -> None:
        reason = str(finished.failure or "")
        self.explorer.tell([finished.configuration], [finished.values])
        self.folder.append(self.explorer, finished.configuration, finished.values, finished.seconds, reason)
        self._done += 1
        self._progress.update(self._done)
        self._look_for_constants()
        if finished.failure:
            self.reasons[reason] += 1
        self._finished += 1
        if finished.failure and not isinstance(finished.failure, InfeasibleError):
            alike = _without_numbers(reason)
            self._alike[alike] += 1
            if self._alike[alike] == self._finished == self.plan.give_up:
                self.stopped = reason

    def _look_for_constants(self) -> None:
        if self._looked_for_constants:
            return
        measured = len(self.explorer.history.measured()[0])
        self._looked_for_constants = measured >= ENOUGH
        for name, value in constant_objectives(self.explorer.history).items():
            self._progress.say(
                f"warning: {name} was {value:g} in all {measured} configurations measured so far: check that "
                "the program really measures it; the search goes on"
            )

    def _end_running(self) -> None:
        """End the running programs; keep the finished measurements."""
        for finished in self.pool.end(self._end):
            self._take(finished)


def _without_numbers(reason: str) -> str:
    """Return a reason without addresses, times and sizes, for comparison."""
    return re.sub(r"0x[0-9a-f]+|\d+", "0", reason)
