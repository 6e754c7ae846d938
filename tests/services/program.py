"""Programs that a test starts, kills and starts again, and a look at the processes of this machine."""

import contextlib
import fcntl
import os
import random
import signal
import socket
import subprocess
import tempfile
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Self

from tests import leaks
from tests.waiting import until

ROOT = Path(__file__).resolve().parents[2]
PORTS = Path(tempfile.gettempdir()) / "frontrunner-ports"


def free_port() -> int:
    """A port of this machine that nothing uses now, that the system gives to no connection, and that no other
    process of tests gets from here.
    """
    chance = random.SystemRandom()
    PORTS.mkdir(exist_ok=True)
    while True:
        port = chance.randrange(12_000, 32_000)
        with socket.socket() as probe, contextlib.suppress(OSError):
            probe.bind(("127.0.0.1", port))
            # The file stays open, and locked, until this process ends.
            fcntl.flock(os.open(PORTS / str(port), os.O_CREAT), fcntl.LOCK_EX | fcntl.LOCK_NB)
            return port


def listens(port: int) -> bool:
    """Whether something on this machine accepts connections at `port`."""
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def children(*pids: int) -> dict[int, str]:
    """The command lines of the running processes that one of `pids` started."""
    listing = subprocess.run(
        ["ps", "-A", "-ww", "-o", "pid=,ppid=,stat=,command="], capture_output=True, text=True, check=True
    )
    rows = (line.split(None, 3) for line in listing.stdout.splitlines())
    return {
        int(pid): command
        for pid, parent, state, command in rows
        if int(parent) in pids and not state.startswith("Z")
    }


def family(pid: int) -> list[int]:
    """`pid` and every running process that descends from it."""
    found = generation = [pid]
    while generation := list(children(*generation)):
        found = found + generation
    return found


def runs(pid: int) -> bool:
    """Whether there is such a process."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


class Program(ABC):
    """A program with its log, in a with statement. What it keeps on disk outlives `kill`."""

    process: subprocess.Popen[bytes]
    folder: Path  # where it is started
    log: Path
    user: str | None = None  # another user than that of the tests
    _start_of_log = 0

    @abstractmethod
    def command(self) -> Sequence[str]:
        """What to run."""

    @abstractmethod
    def ready(self) -> bool:
        """Whether it does its work already."""

    def environment(self) -> Mapping[str, str]:
        """Its environment."""
        return os.environ

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()

    def start(self) -> None:
        """Start, and return as soon as it is ready. AssertionError with its words where it ends instead."""
        before = getattr(self, "process", None)
        with self.log.open("ab") as log:
            self._start_of_log = log.tell()
            self.process = subprocess.Popen(
                self.command(),
                env=self.environment(),
                cwd=self.folder,
                user=self.user,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
            )
        if before is not None:
            leaks.allow(self.process, instead_of=before)
        try:
            until(lambda: self.process.poll() is not None or self.ready())
            assert self.process.poll() is None, self.said()
        except BaseException:
            self.kill()
            raise

    def kill(self) -> None:
        """kill -9, of whatever it started too: as when a machine runs out of memory."""
        for pid in family(self.process.pid):
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        self.process.wait()

    def said(self) -> str:
        """What it printed since it was started."""
        return self.log.read_bytes()[self._start_of_log :].decode(errors="replace")
