"""A real `manage.py serve` with its real children, and what a client does to it over HTTP."""

import http.client
import json
import os
import signal
import sqlite3
import subprocess
import sys
import urllib.error
import urllib.request
import uuid
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import psycopg

from tests.services.program import ROOT, Program, children, free_port
from tests.waiting import PATIENCE_SECONDS, until

Services = dict[str, str]
EACH = """
import contextlib, io, json
from crowd.__main__ import main
from django.db import connections
done = []
for words in {}:
    output, errors = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(errors):
        code = main(["manage.py", *words])
    connections.close_all()
    done.append([code, output.getvalue(), errors.getvalue()])
print(json.dumps(done))
"""


def command(var: Path, *arguments: str, **services: str) -> subprocess.CompletedProcess[str]:
    """`manage.py ARGUMENTS` on the data folder `var`."""
    return subprocess.run(
        [sys.executable, "manage.py", *arguments],
        cwd=ROOT,
        env=environment(var, **services),
        capture_output=True,
        text=True,
        check=False,
    )


def commands(var: Path, *lines: str, **services: str) -> str:
    """What `manage.py LINE` prints for each of `lines`, in one process: its start is what costs most."""
    calls = [f"call(*{line.split()!r})" for line in lines]
    return shell(
        var, "; ".join(["from django.core.management import call_command as call", *calls]), **services
    )


def each(var: Path, *lines: str, **services: str) -> list[subprocess.CompletedProcess[str]]:
    """As `command` for each of `lines`, one after another in one process."""
    words = [line.split() for line in lines]
    done = json.loads(shell(var, EACH.format(words), **services))
    return [subprocess.CompletedProcess(each, *result) for each, result in zip(words, done, strict=True)]


def refusal(done: subprocess.CompletedProcess[str]) -> str:
    """The one line that a command says, which must have failed."""
    assert done.returncode == 1, done.stdout
    (line,) = done.stderr.strip().splitlines()
    return line


def connect(var: Path, services: Services) -> Any:
    """A connection to a server's database: a start of Django is slow."""
    if "DATABASE_URL" in services:
        return psycopg.connect(services["DATABASE_URL"], autocommit=True)
    return sqlite3.connect(var / "frontrunner.sqlite3", timeout=60, isolation_level=None)


def shell(var: Path, script: str, **services: str) -> str:
    """What `script` prints where Django is set up for the data folder `var`."""
    done = command(var, "shell", "--no-imports", "-c", script, **services)
    assert done.returncode == 0, done.stderr
    return done.stdout


def environment(var: Path, **services: str) -> dict[str, str]:
    """This process's environment with the data folder `var` and with `services`, and no other setting of
    ours."""
    kept = {
        name: value
        for name, value in os.environ.items()
        if not name.startswith(("FRONTRUNNER_", "DATABASE_", "CELERY_", "DJANGO_"))
    }
    return kept | {"FRONTRUNNER_VAR": str(var)} | services


class Serving(Program):
    """One server on a data folder of its own. Use it in a with statement."""

    def __init__(self, var: Path, services: Services) -> None:
        self.var, self.services, self.port = var, services, free_port()
        self.url = f"http://127.0.0.1:{self.port}"
        self.folder, self.log = ROOT, var / f"serve-{self.port}.txt"

    def command(self) -> Sequence[str]:
        return [sys.executable, "-u", "manage.py", "serve"]

    def environment(self) -> Mapping[str, str]:
        return environment(self.var, **self.services, FRONTRUNNER_PORT=str(self.port))

    def ready(self) -> bool:
        return "Dashboard:" in self.said()

    def start(self) -> None:
        self.var.mkdir(exist_ok=True)
        super().start()

    def __exit__(self, *_: object) -> None:
        self.process.send_signal(signal.SIGINT)
        self.process.wait(PATIENCE_SECONDS)

    def pids(self, word: str = "") -> list[int]:
        """The supervisor's children whose command line holds `word`."""
        return [pid for pid, command in children(self.process.pid).items() if word in command]

    def kill_child(self, word: str) -> None:
        """kill -9 the child whose command line holds `word`; the supervisor starts it again."""
        (pid,) = until(lambda: self.pids(word))
        os.kill(pid, signal.SIGKILL)

    def call(self, method: str, path: str, document: Any = None, **headers: str) -> tuple[int, Any]:
        """Status and JSON of one request. Raises OSError where the server does not answer to the end."""
        request = urllib.request.Request(
            f"{self.url}{path}",
            method=method,
            data=None if document is None else json.dumps(document).encode(),
            headers={"Content-Type": "application/json", **headers},
        )
        try:
            response = urllib.request.urlopen(request, timeout=30)
        except urllib.error.HTTPError as error:
            response = error
        try:
            with response:
                return response.status, json.loads(response.read() or "null")
        except http.client.IncompleteRead as error:
            raise ConnectionAbortedError(f"the answer was cut short: {error}") from error

    def enrol(self) -> str:
        """The token of a new installation."""
        wish = {"app": "test", "app_version": "0.1.0", "consent_version": 2}
        status, answer = self.call("POST", "/api/v1/enrol", wish)
        assert status == 201, answer
        return str(answer["token"])

    def submit_until_accepted(self, token: str, document: Any) -> int:
        """As a client with a spool does: again under the same key until the server says that it has it."""
        key = str(uuid.uuid4())

        def attempt() -> int:
            try:
                status, _ = self.call(
                    "POST",
                    "/api/v1/submissions",
                    document,
                    Authorization=f"Bearer {token}",
                    **{"Idempotency-Key": key},
                )
            except OSError:
                return 0
            return status if status in {200, 202} else 0

        return int(until(attempt))

    def waiting(self) -> int | None:
        """How many sessions wait for their summary; None while the server does not answer."""
        try:
            _, state = self.call("GET", "/readyz")
        except OSError:
            return None
        waiting: int = state["sessions_waiting"]
        return waiting
