"""A real `manage.py serve` with its real children, and what a client does to it over HTTP."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
import uuid
from collections.abc import Callable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
PATIENCE_SECONDS = 60.0
Services = dict[str, str]


def free_port() -> int:
    """A port of this machine that nothing uses now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def until(condition: Callable[[], Any], patience: float = PATIENCE_SECONDS) -> Any:
    """What CONDITION gives as soon as that is true; AssertionError when PATIENCE is over."""
    limit = time.monotonic() + patience
    while not (value := condition()):
        assert time.monotonic() < limit, f"waited {patience:.0f} s in vain"
        time.sleep(0.05)
    return value


def command(var: Path, *arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """`manage.py ARGUMENTS` on the data folder VAR."""
    return subprocess.run(
        [sys.executable, "manage.py", *arguments],
        cwd=ROOT,
        env=_environment(var, **environment),
        capture_output=True,
        text=True,
        check=False,
    )


def _environment(var: Path, **environment: str) -> dict[str, str]:
    kept = {
        name: value
        for name, value in os.environ.items()
        if not name.startswith(("FRONTRUNNER_", "DATABASE_", "CELERY_", "DJANGO_"))
    }
    return kept | {"FRONTRUNNER_VAR": str(var)} | environment


class Serving:
    """One server on a data folder of its own. Use it in a with statement."""

    def __init__(self, var: Path, services: Services) -> None:
        self.var, self.services, self.port = var, services, free_port()
        self.url = f"http://127.0.0.1:{self.port}"
        self.output = var / "serve.txt"

    def __enter__(self) -> "Serving":
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.process.send_signal(signal.SIGINT)
        self.process.wait(PATIENCE_SECONDS)

    def start(self) -> None:
        """Start, and return as soon as it serves."""
        self.var.mkdir(exist_ok=True)
        environment = _environment(self.var, **self.services, FRONTRUNNER_PORT=str(self.port))
        with self.output.open("w") as output:
            self.process = subprocess.Popen(
                [sys.executable, "-u", "manage.py", "serve"],
                cwd=ROOT,
                env=environment,
                stdout=output,
                stderr=subprocess.STDOUT,
            )
        until(lambda: self.process.poll() is not None or "Dashboard:" in self.output.read_text())
        assert self.process.poll() is None, self.output.read_text()

    def pids(self, word: str = "") -> list[int]:
        """The supervisor's children whose command line holds WORD."""
        listing = subprocess.run(
            ["ps", "-A", "-o", "pid=,ppid=,command="], capture_output=True, text=True, check=True
        )
        rows = (line.split(None, 2) for line in listing.stdout.splitlines())
        return [
            int(pid)
            for pid, parent, command in rows
            if int(parent) == self.process.pid and word in command and "defunct" not in command
        ]

    def kill(self, word: str) -> None:
        """kill -9 the child whose command line holds WORD."""
        (pid,) = until(lambda: self.pids(word))
        os.kill(pid, signal.SIGKILL)

    def call(self, method: str, path: str, document: Any = None, **headers: str) -> tuple[int, Any]:
        """Status and JSON of one request. Raises OSError where the server does not answer."""
        request = urllib.request.Request(
            f"{self.url}{path}",
            method=method,
            data=None if document is None else json.dumps(document).encode(),
            headers={"Content-Type": "application/json", **headers},
        )
        try:
            with urllib.request.urlopen(request, timeout=30) as response:
                return response.status, json.loads(response.read() or "null")
        except urllib.error.HTTPError as error:
            return error.code, json.loads(error.read() or "null")

    def enrol(self) -> str:
        """The token of a new installation."""
        wish = {"app": "test", "app_version": "0.1.0", "consent_version": 1}
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
