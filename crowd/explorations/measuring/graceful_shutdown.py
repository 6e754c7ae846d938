"""Lets a worker that shuts down return its evaluation, instead of being killed during it.

Celery lets a worker finish its task, but a measurement can take longer than the supervisor waits. It is only
interrupted in the process that gets the signal (`--pool solo`); children of other pools finish their task.
"""

from collections.abc import Iterator
from contextlib import contextmanager

from celery.exceptions import WorkerShutdown
from celery.signals import worker_shutting_down


class ShutdownSwitch:
    """Raises WorkerShutdown inside `interruptible`, except inside `protected`, after `request`."""

    def __init__(self) -> None:
        self._requested = self._interruptible = False

    def request(self) -> None:
        """Request the shutdown. Raises WorkerShutdown now or at the next interruptible point."""
        self._requested = True
        self._check()

    @contextmanager
    def interruptible(self) -> Iterator[None]:
        """A block in which a requested shutdown raises WorkerShutdown."""
        with self._set(True):
            self._check()
            yield

    @contextmanager
    def protected(self) -> Iterator[None]:
        """A block that is finished first, such as a write to the database."""
        with self._set(False):
            yield
        self._check()

    @contextmanager
    def _set(self, allowed: bool) -> Iterator[None]:
        before, self._interruptible = self._interruptible, allowed
        try:
            yield
        finally:
            self._interruptible = before

    def _check(self) -> None:
        if self._requested and self._interruptible:
            raise WorkerShutdown(0)


shutdown = ShutdownSwitch()


def end_measurement(**_: object) -> None:
    """Celery calls this in the handler of the signal that ends the worker."""
    shutdown.request()


worker_shutting_down.connect(end_measurement)
