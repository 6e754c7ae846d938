"""A supervisor: starts child processes, restarts those that die, and stops them together.

A child has its own process group, so that everything it started ends with it. On Linux it gets a signal when
the supervisor dies, even by kill -9. A data folder has one supervisor at a time.
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

from crowd.observability.environment import DataFolderError, make_writable_folder
from slam.child_process import dies_with_parent

FIRST_PAUSE_SECONDS = 0.5
LONGEST_PAUSE_SECONDS = 30.0
# After a run of this length, the next restart has a short pause again.
STABLE_AFTER_SECONDS = 30.0
TIMEOUT_SECONDS = 10.0
POLL_SECONDS = 0.1
LARGEST_LOG_BYTES = 10 << 20


@contextlib.contextmanager
def exclusive_lock(folder: Path) -> Iterator[None]:
    """Lock the data `folder` for this supervisor. Raises DataFolderError if another one has it.

    The lock ends with the process, even if it is killed; the file stays.
    """
    with (make_writable_folder(folder) / "serve.lock").open("a+") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            file.seek(0)
            raise DataFolderError(
                f"process {file.read()} uses {folder}: end it first, or choose another "
                "folder, such as make run DATA=FOLDER PORT=8001"
            ) from error
        file.truncate(0)
        file.write(str(os.getpid()))
        file.flush()
        yield


@dataclass
class Child:
    """A process to keep alive; its output is appended to `log`."""

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

    def exit_reason(self) -> str | None:
        """How the process ended; None while it runs."""
        code = self.process.poll() if self.process else None
        if code is None:
            return None
        return f"was killed by signal {-code}" if code < 0 else f"ended with code {code}"

    def shorten_log(self) -> None:
        """Copy a large log away and empty it. The process has it open and continues at its new end."""
        if not self.log.exists() or self.log.stat().st_size <= LARGEST_LOG_BYTES:
            return
        # On a full disk the log is emptied without a copy.
        with contextlib.suppress(OSError):
            shutil.copyfile(self.log, self.log.with_suffix(".old.log"))
        os.truncate(self.log, 0)

    def end_group(self) -> None:
        """Kill what is left of the process and its descendants."""
        if self.process is None:
            return
        # macOS gives PermissionError for a group of zombies.
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()


@dataclass
class Supervisor:
    """Keeps `children` alive. `say` receives a line for each event."""

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
        """Restart every child that died, with growing pauses for a child that keeps dying."""
        now = time.monotonic()
        for child in self.children:
            child.shorten_log()
            if child.process is not None and (reason := child.exit_reason()) is not None:
                child.end_group()
                child.process = None
                child.pause = (
                    FIRST_PAUSE_SECONDS
                    if now - child.started > STABLE_AFTER_SECONDS
                    else min(child.pause * 2, LONGEST_PAUSE_SECONDS)
                )
                child.due = now + child.pause
                self.say(
                    f"The {child.name} {reason}; starting it again in {child.pause:.0f} s. Log: {child.log}"
                )
            elif child.process is None and now >= child.due:
                child.start()

    def wait(self, done: Callable[[], bool], timeout: float | None = None) -> bool:
        """Watch the children until `done`, or for `timeout` seconds. Returns whether it is done."""
        start = time.monotonic()
        while not done():
            if timeout is not None and time.monotonic() - start > timeout:
                return False
            self.watch()
            time.sleep(POLL_SECONDS)
        return True

    def stop(self) -> None:
        """Stop all children: by SIGTERM, and after TIMEOUT_SECONDS by SIGKILL."""
        running = [child for child in self.children if child.process is not None]
        for child in running:
            assert child.process is not None
            child.process.terminate()
        limit = time.monotonic() + TIMEOUT_SECONDS
        for child in running:
            assert child.process is not None
            try:
                child.process.wait(max(0.0, limit - time.monotonic()))
            except subprocess.TimeoutExpired:
                self.say(f"The {child.name} does not end by itself: killed")
            child.end_group()
