"""Many clients at one moment, while the database is locked so that nothing they write gets done."""

import json
import random
import selectors
import socket
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from tests.services.serving import Serving
from tests.services.strangers import ENROLMENT
from tests.waiting import PATIENCE_SECONDS, until

ENROLMENT_BODY = json.dumps(ENROLMENT)
HEAD = "POST /api/v1/enrol HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/json\r\n"


@contextmanager
def locked(var: Path) -> Iterator[None]:
    """The database in `var` cannot be written."""
    with closing(sqlite3.connect(var / "frontrunner.sqlite3", timeout=60, isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        yield
        other.execute("ROLLBACK")


def installations(var: Path, app: str = str(ENROLMENT["app"])) -> int:
    """How many are enrolled with the program `app`."""
    query = "SELECT count(*) FROM devices_installation WHERE app = ?"
    with closing(sqlite3.connect(var / "frontrunner.sqlite3", timeout=60)) as database:
        return int(database.execute(query, (app,)).fetchone()[0])


def enrolling(server: Serving, address: str) -> socket.socket:
    """A client at `address` that has sent its whole enrolment."""
    line = socket.create_connection(("127.0.0.1", server.port), PATIENCE_SECONDS)
    more = f"X-Forwarded-For: {address}\r\nContent-Length: {len(ENROLMENT_BODY)}\r\n\r\n{ENROLMENT_BODY}"
    line.sendall(f"{HEAD}{more}".encode())
    return line


def answers(lines: Sequence[socket.socket], count: int) -> list[bytes]:
    """The first piece of each answer, once at least `count` of `lines` have one."""
    found: list[bytes] = []
    with selectors.DefaultSelector() as selector:
        for line in lines:
            selector.register(line, selectors.EVENT_READ)

        def read() -> bool:
            for key, _ in selector.select(1):
                found.append(key.fileobj.recv(1 << 16))  # type: ignore[union-attr]
                selector.unregister(key.fileobj)
            return len(found) >= count

        until(read)
    return found


def until_taken(ask: Any, chance: random.Random) -> int:
    """The status that `ask` is answered with in the end: 503 is waited for, as clients do."""

    def attempt() -> int:
        status = int(ask()[0])
        return 0 if status == 503 else status

    # A fraction of Retry-After: more would only take longer.
    return int(until(attempt, pause=chance.uniform(0.2, 1)))
