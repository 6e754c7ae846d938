"""A server that takes submissions, and what participants with bad lines do to it."""

import atexit
import http.client
import json
import random
import shutil
import socket
import tempfile
import threading
import urllib.request
import uuid
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

from tests.builders.documents import front_document, session_document, submission_document, write_pack
from tests.services.postgresql import PostgreSQL
from tests.services.serving import Services, Serving, commands
from tests.waiting import until

SUBMISSIONS = "/api/v1/submissions"
DISCONNECTS = 0.4
# No test reaches a rate limit by its many requests.
LIMITS = {"FRONTRUNNER_LIMITS": "0", "FRONTRUNNER_RARE_BELOW": "1"}


def prepare(var: Path, services: Services) -> None:
    """Make `var` a data folder with a published front; real databases are emptied first."""
    if "DATABASE_URL" in services:
        _publish(var, services)
    else:
        shutil.copytree(_prepared(), var, dirs_exist_ok=True)


@contextmanager
def prepared_on(postgresql: PostgreSQL, var: Path) -> Iterator[str]:
    """The URL of a new database with the same content, and its data folder `var`."""
    shutil.copytree(_prepared(), var, ignore=shutil.ignore_patterns("frontrunner.sqlite3*"))
    with postgresql.database(_prepared_database(postgresql)) as url:
        yield url


@cache
def _prepared() -> Path:
    """A data folder of the embedded default, to be copied: starting commands is what costs most.

    It is prepared as a server prepares it, which then starts sooner.
    """
    folder = Path(tempfile.mkdtemp(prefix="frontrunner-prepared-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    _publish(folder, {}, "prepare")
    return folder


@cache
def _prepared_database(postgresql: PostgreSQL) -> str:
    """The name of a database of PostgreSQL, to be copied."""
    name = "prepared"
    publish = f"front publish {_prepared() / 'front.json'} --yes"
    commands(_prepared(), "migrate", publish, "prepare", DATABASE_URL=postgresql.create(name))
    return name


def _publish(var: Path, services: Services, *more: str) -> None:
    """Bring the tables up to date, empty them, publish a front; carry out `more` commands."""
    path = var / "front.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(front_document(write_pack(var / "sequences"))))
    lines = ["migrate", "flush --no-input", f"front publish {path} --yes", *more]
    commands(var, *lines, **services)


def own_runs(server: Serving, token: str) -> list[str]:
    """The ids of all runs that are kept of `token`'s installation, in order."""
    _, data = server.call("GET", "/api/v1/me/data", Authorization=f"Bearer {token}")
    return sorted(run["id"] for session in data["sessions"] for run in session["runs"])


def runs_of(documents: Iterable[dict[str, Any]]) -> list[str]:
    """The ids of all runs in `documents`, in order."""
    return sorted(
        run["id"] for document in documents for session in document["sessions"] for run in session["runs"]
    )


def text_of(server: Serving, path: str) -> str:
    """What the server answers at `path`. Raises OSError where it does not."""
    with urllib.request.urlopen(f"{server.url}{path}", timeout=30) as answer:
        return str(answer.read().decode())


def answers(server: Serving) -> bool:
    """Whether the server is there."""
    try:
        return text_of(server, "/healthz") == "ok\n"
    except OSError:
        return False


class Participant(threading.Thread):
    """Sends so many submissions, hangs up in the middle of some, and tries each until it is taken."""

    def __init__(self, server: Serving, submissions: int, seed: int) -> None:
        super().__init__()
        self.server, self.chance = server, random.Random(seed)
        self.documents = [submission_document(session_document()) for _ in range(submissions)]
        self.token = server.enrol()
        self.answers: list[int] = []  # statuses, of refusals too
        self.taken = 0

    def run(self) -> None:
        for document in self.documents:
            body, key = json.dumps(document).encode(), str(uuid.uuid4())
            until(lambda body=body, key=key: self._send(body, key) in {200, 202})
            self.taken += 1

    def _send(self, body: bytes, key: str) -> int:
        """The status of the answer, 0 where there is none."""
        headers = {
            "Content-Type": "application/json",
            "Authorization": f"Bearer {self.token}",
            "Idempotency-Key": key,
        }
        if self.chance.random() < DISCONNECTS:
            self._hang_up(body, headers)
            return 0
        connection = http.client.HTTPConnection("127.0.0.1", self.server.port, timeout=30)
        try:
            connection.request("POST", SUBMISSIONS, body, headers)
            status = connection.getresponse().status
        except (OSError, http.client.HTTPException):
            return 0
        finally:
            connection.close()
        self.answers.append(status)
        return status

    def _hang_up(self, body: bytes, headers: dict[str, str]) -> None:
        """Send the request, or a part of it, and read no answer."""
        head = "".join(f"{name}: {value}\r\n" for name, value in headers.items())
        request = (
            f"POST {SUBMISSIONS} HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: {len(body)}\r\n{head}\r\n"
        )
        whole = request.encode() + body
        length = self.chance.choice([len(whole), self.chance.randrange(1, len(whole))])
        try:
            with socket.create_connection(("127.0.0.1", self.server.port), timeout=30) as line:
                line.sendall(whole[:length])
        except OSError:
            pass  # the server is away: there was no line to lose
