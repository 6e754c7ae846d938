"""A worker that has to end gives back what it measures, instead of being killed for taking too long.

Celery lets a worker finish its task first, and a measurement takes longer than whoever ends it waits. It can
be interrupted only where it is made by the process that is told (`--pool solo`): what the children of other
pools measure is finished.
"""

from collections.abc import Iterator
from contextlib import contextmanager

from celery.exceptions import WorkerShutdown
from celery.signals import worker_shutting_down


class Interruption:
    """Ends what runs inside of `allowed` as soon as that is asked for, but for what `held_off` surrounds."""

    def __init__(self) -> None:
        self._asked = self._allowed = False

    def ask(self) -> None:
        """End what may be ended now or later. Raises WorkerShutdown where that is so now."""
        self._asked = True
        self._check()

    @contextmanager
    def allowed(self) -> Iterator[None]:
        """Raises WorkerShutdown at the moment when it is asked for, or was."""
        with self._set(True):
            self._check()
            yield

    @contextmanager
    def held_off(self) -> Iterator[None]:
        """What is inside is finished first, such as a write to the database."""
        with self._set(False):
            yield
        self._check()

    @contextmanager
    def _set(self, allowed: bool) -> Iterator[None]:
        before, self._allowed = self._allowed, allowed
        try:
            yield
        finally:
            self._allowed = before

    def _check(self) -> None:
        if self._asked and self._allowed:
            raise WorkerShutdown(0)


measuring = Interruption()


@worker_shutting_down.connect
def end_measurement(**_: object) -> None:
    """Celery calls this from the handler of the signal that asks the worker to end."""
    measuring.ask()
