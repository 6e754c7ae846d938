"""Ctrl-C, SIGTERM and SIGHUP, delivered at safe moments."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


class Interrupts:
    """Signals as KeyboardInterrupt, deferred while held."""

    def __init__(self) -> None:
        self._holding = self._waiting = self._ignoring = False

    @contextmanager
    def held(self) -> Iterator[None]:
        """Finish the block before an interrupt that arrived meanwhile is raised."""
        self._holding = True
        try:
            yield
        finally:
            self._holding = False
        if self._waiting and not self._ignoring:
            self._waiting = False
            raise KeyboardInterrupt

    def ignore(self) -> None:
        """Ignore signals from now on: the program is ending."""
        self._ignoring = True

    def take(self, _signal: int, _frame: FrameType | None) -> None:
        """Handle a signal."""
        if self._ignoring:
            return
        if self._holding:
            self._waiting = True
        else:
            raise KeyboardInterrupt


@contextmanager
def interruptible() -> Iterator[Interrupts]:
    """Raise KeyboardInterrupt in the block on SIGINT, SIGTERM, and SIGHUP unless that is ignored (nohup)."""
    interrupts = Interrupts()
    # Python handles signals in the main thread only.
    if threading.current_thread() is not threading.main_thread():
        yield interrupts
        return
    numbers = [signal.SIGINT, signal.SIGTERM]
    if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) != signal.SIG_IGN:
        numbers.append(signal.SIGHUP)
    before = {number: signal.signal(number, interrupts.take) for number in numbers}
    try:
        yield interrupts
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
