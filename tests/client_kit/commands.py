"""The client's commands as their user gives them, in this process, or as a program to be killed."""

import contextlib
import io
import os
import signal
import subprocess
import sys
from pathlib import Path
from unittest import mock

from client_kit.__main__ import main
from client_kit.home import Home
from client_kit.interrupts import ENDING

PROJECT = Path(__file__).parents[2]


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


def client(home: Home, *arguments: str) -> "subprocess.CompletedProcess[str]":
    """The command in this process: what it printed, and its exit code."""
    out, error = io.StringIO(), io.StringIO()
    handlers = {number: signal.getsignal(number) for number in ENDING}
    with (
        mock.patch.dict(os.environ, FRONTRUNNER_HOME=str(home.path)),
        mock.patch.object(sys, "stdin", io.StringIO()),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(error),
    ):
        try:
            code = main(arguments)
        except SystemExit as ended:
            code = ended.code if isinstance(ended.code, int) else 1
        finally:
            for number, handler in handlers.items():
                signal.signal(number, handler)
    return subprocess.CompletedProcess(arguments, code, out.getvalue(), error.getvalue())
