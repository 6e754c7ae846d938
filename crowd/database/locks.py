"""Locks by name, which end with their holder: of all machines that share a database."""

import fcntl
import hashlib
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from django.conf import settings
from django.db import connection

POLL_SECONDS = 0.05


@contextmanager
def lock(name: str, seconds: float) -> Iterator[bool]:
    """Lock `name`; waits for at most `seconds`. Yields whether the lock is held.

    PostgreSQL keeps it for the connection. SQLite has no such locks and is used by one machine: there, it is
    the file NAME.lock of the data folder.
    """
    end = time.monotonic() + seconds
    holding = _of_postgresql if connection.vendor == "postgresql" else _of_file
    with holding(name) as attempt:
        while not (held := attempt()) and time.monotonic() < end:
            time.sleep(POLL_SECONDS)
        yield held


@contextmanager
def _of_postgresql(name: str) -> Iterator[Callable[[], bool]]:
    key = int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], signed=True)
    held = False

    def attempt() -> bool:
        nonlocal held
        held = _ask("SELECT pg_try_advisory_lock(%s)", key)
        return held

    try:
        yield attempt
    finally:
        if held:
            _ask("SELECT pg_advisory_unlock(%s)", key)


def _ask(query: str, key: int) -> bool:
    with connection.cursor() as cursor:
        cursor.execute(query, [key])
        (found,) = cursor.fetchone()
    return bool(found)


@contextmanager
def _of_file(name: str) -> Iterator[Callable[[], bool]]:
    with (Path(settings.FRONTRUNNER_VAR) / f"{name}.lock").open("w") as file:

        def attempt() -> bool:
            try:
                fcntl.flock(file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                return False
            return True

        yield attempt  # closing the file releases the lock
