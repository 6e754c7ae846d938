"""The client's commands as their user gives them, in this process, or as a program to be killed."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from client_kit.__main__ import main
from client_kit.delivery.spool import Spool
from client_kit.home import Home
from client_kit.interrupts import ENDING
from tests.client_kit.scripted import Answer, ScriptedServer, Serve

PROJECT = Path(__file__).parents[2]


class Terminal:
    """Commands in this process, with a home of their own, and the servers that they talk to."""

    server: ScriptedServer  # of the last `run`

    def __init__(self, home: Home, serve: Serve, capsys: pytest.CaptureFixture[str]) -> None:
        self._home, self._serve, self._capsys = home, serve, capsys

    def __call__(self, *arguments: str) -> tuple[int, str, str]:
        """Exit code, standard output and error; AssertionError where an error is not one line."""
        handlers = {number: signal.getsignal(number) for number in ENDING}
        try:
            code = main(arguments)
        finally:
            for number, handler in handlers.items():
                signal.signal(number, handler)
        output = self._capsys.readouterr()
        assert len(output.err.splitlines()) == (1 if code else 0), output.err
        return code, output.out, output.err

    def run(self, answer: Answer, *options: str, port: int = 0) -> tuple[int, str, str]:
        """`run` with agreement, against a server that answers so."""
        self.server = self._serve(answer, port)
        return self("run", "--yes", "--server", self.server.url, *options)

    def states(self) -> list[str]:
        """Of the sessions that the spool holds."""
        return [item.state for item in Spool(self._home.spool).items()]


def start(home: Home, *arguments: str) -> "subprocess.Popen[str]":
    """The command as a program of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", "client_kit", *arguments],
        cwd=PROJECT,
        env={**os.environ, "FRONTRUNNER_HOME": str(home.path)},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
