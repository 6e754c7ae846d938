"""Child processes of one supervisor: started together, started again when they die, ended together.

A child gets a process group of its own, so that whatever it started ends with it, and on Linux a signal
when the supervisor dies, even by kill -9. A data folder has one supervisor at a time.
"""

import contextlib
import fcntl
import os
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from crowd.operations.environment import DataFolderError, prepared
from slam.child_process import dies_with_parent

FIRST_PAUSE_SECONDS = 0.5
LONGEST_PAUSE_SECONDS = 30.0
# A child that ran this long was well: its next death starts with a short pause again.
WELL_AFTER_SECONDS = 30.0
PATIENCE_SECONDS = 10.0
POLL_SECONDS = 0.1
LARGEST_LOG_BYTES = 10 << 20


@contextlib.contextmanager
def alone(folder: Path) -> Iterator[None]:
    """Be the one supervisor of the data FOLDER. Raises DataFolderError where another one runs.

    The lock ends with its process, however that ends; the file stays.
    """
    with (prepared(folder) / "serve.lock").open("a+") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            file.seek(0)
            raise DataFolderError(
                f"process {file.read()} serves from {folder} already: end it first, or choose another "
                "folder, such as make run DATA=FOLDER PORT=8001"
            ) from error
        file.truncate(0)
        file.write(str(os.getpid()))
        file.flush()
        yield


@dataclass
class Child:
    """A process to be kept alive; what it prints goes to the end of LOG."""

    name: str
    command: Sequence[str]
    log: Path
    environment: Mapping[str, str]
    folder: Path
    process: subprocess.Popen[bytes] | None = None
    started: float = 0.0
    pause: float = FIRST_PAUSE_SECONDS
    due: float = field(default=0.0)

    def start(self) -> None:
        """Start the process."""
        self.log.parent.mkdir(parents=True, exist_ok=True)
        with self.log.open("ab") as output:
            self.process = subprocess.Popen(
                self.command,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                env=self.environment,
                cwd=self.folder,
                start_new_session=True,
                preexec_fn=dies_with_parent(signal.SIGTERM),
            )
        self.started = time.monotonic()

    def ended(self) -> str | None:
        """How the process ended, None while it runs."""
        code = self.process.poll() if self.process else None
        if code is None:
            return None
        return f"was killed by signal {-code}" if code < 0 else f"ended with code {code}"

    def shorten_log(self) -> None:
        """Put the log aside where it has grown large, under the process's open file: it writes at its end."""
        if not self.log.exists() or self.log.stat().st_size <= LARGEST_LOG_BYTES:
            return
        # A full disk takes no copy; the log then goes without one.
        with contextlib.suppress(OSError):
            shutil.copyfile(self.log, self.log.with_suffix(".old.log"))
        os.truncate(self.log, 0)

    def end_group(self) -> None:
        """Kill what is left of the process and of everything that it started."""
        if self.process is None:
            return
        # macOS gives PermissionError for a group of zombies.
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()


@dataclass
class Supervisor:
    """Keeps CHILDREN alive. `say` hears in a line what happens to them."""

    children: list[Child]
    say: Callable[[str], None]

    def start(self) -> None:
        """Start all children."""
        for child in self.children:
            child.start()

    def add(self, child: Child) -> None:
        """Start one more child."""
        self.children.append(child)
        child.start()

    def watch(self) -> None:
        """Start again every child that died; a child that keeps dying is tried less and less often."""
        now = time.monotonic()
        for child in self.children:
            child.shorten_log()
            if child.process is not None and (how := child.ended()) is not None:
                child.end_group()
                child.process = None
                child.pause = (
                    FIRST_PAUSE_SECONDS
                    if now - child.started > WELL_AFTER_SECONDS
                    else min(child.pause * 2, LONGEST_PAUSE_SECONDS)
                )
                child.due = now + child.pause
                self.say(
                    f"The {child.name} {how}; starting it again in {child.pause:.0f} s. Log: {child.log}"
                )
            elif child.process is None and now >= child.due:
                child.start()

    def wait(self, done: Callable[[], bool], patience: float | None = None) -> bool:
        """Watch the children until DONE, or for PATIENCE seconds; whether it is done."""
        start = time.monotonic()
        while not done():
            if patience is not None and time.monotonic() - start > patience:
                return False
            self.watch()
            time.sleep(POLL_SECONDS)
        return True

    def stop(self) -> None:
        """End all children: politely, and after PATIENCE_SECONDS by force."""
        running = [child for child in self.children if child.process is not None]
        for child in running:
            assert child.process is not None
            child.process.terminate()
        limit = time.monotonic() + PATIENCE_SECONDS
        for child in running:
            assert child.process is not None
            try:
                child.process.wait(max(0.0, limit - time.monotonic()))
            except subprocess.TimeoutExpired:
                self.say(f"The {child.name} does not end by itself: killed")
            child.end_group()
