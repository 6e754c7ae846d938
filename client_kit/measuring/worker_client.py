"""Measuring in a separate process, since a driver may abort, hang or exhaust the memory.

The process (`worker`) serves a whole session: opening a device and compiling for it takes seconds. If it
breaks, the measured configuration has failed, and a new process measures the next.
"""

import contextlib
import json
import queue
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from client_kit.errors import CannotMeasureError
from client_kit.measuring import reasons
from slam import child_process

PROGRAM = (sys.executable, "-m", "client_kit.measuring.worker")
# Longer than any frame: the first one includes the driver's compiler, which takes a minute on some phones.
LONGEST_SILENCE_SECONDS = 180

# Called with the numbers of frames, or kernel layouts, done and in total.
Progress = Callable[[int, int], None]


class FailedError(Exception):
    """This configuration does not run here; the text is the reason, without private data."""


class BrokenError(FailedError):
    """It broke the measuring process, and would do so again."""


class DeviceBrokenError(FailedError):
    """The device cannot be opened again: no further configuration can run."""


@dataclass(frozen=True)
class Outcome:
    """`report` is that of `slam run`. `positions`: the camera's position after each frame, [x, y, z] in
    metres, in the volume's frame. `cpu_us` and `waited_us`: of the counted frames, see `processor_time`."""

    report: Mapping[str, Any]
    positions: Sequence[Sequence[float]]
    cpu_us: int | None = None
    waited_us: int | None = None


class WorkerClient:
    """Measures configurations one after another on one device and one sequence. A context manager.

    `device` is the label of a device of `backend`. `on_layout` is called while kernel layouts are tried on a
    new device.
    """

    def __init__(
        self, application: str, sequence: Path, device: str, backend: str, on_layout: Progress
    ) -> None:
        self._setting = {
            "application": application,
            "sequence": str(sequence.absolute()),
            "device": device,
            "backend": backend,
        }
        self._on_layout = on_layout
        self._process: _Process | None = None
        self._served = False  # whether the device was opened before

    def __enter__(self) -> "WorkerClient":
        return self

    def __exit__(self, *_: object) -> None:
        self._close()

    def empty_frame_seconds(self) -> float:
        """Median wall seconds of an empty frame. Raises as `measure` does."""
        return float(self._answer({"empty_frame": True}, _nothing_between)["empty_frame_seconds"])

    def measure(
        self, parameters: Mapping[str, Any], frames: int, first: int, between_frames: Progress
    ) -> Outcome:
        """Measure a configuration over the first `frames` frames, of which those from `first` on count.

        The process waits while `between_frames` is called. Raises FailedError or a subclass. Raises
        CannotMeasureError where the sequence cannot be used, no process can be started, or the device cannot
        be opened the first time.
        """
        order = {"parameters": dict(parameters), "frames": frames, "first": first}
        answer = self._answer(order, between_frames)
        return Outcome(answer["report"], answer["positions"], answer["cpu_us"], answer["waited_us"])

    def _answer(self, order: Mapping[str, Any], between_frames: Progress) -> dict[str, Any]:
        process = self._process or self._open()
        try:
            process.order(order)
            while "done" in (answer := process.answer()):
                between_frames(answer["done"], answer["total"])
                process.go_on()
        except _EndedError as error:
            self._close()
            raise BrokenError(str(error)) from error
        except BaseException:
            self._close()  # it still runs a measurement that was abandoned
            raise
        if "failure" in answer:
            raise FailedError(answer["failure"])
        return answer

    def _open(self) -> "_Process":
        try:
            self._process = _Process(self._on_layout)
            self._process.order(self._setting)
            self._process.answer()
        except _EndedError as error:
            self._close()
            raise DeviceBrokenError(str(error)) from error
        except CannotMeasureError as error:
            self._close()
            if self._served:  # it was removed, or the system cannot start a process
                raise DeviceBrokenError(reasons.public_line(str(error))) from error
            raise
        except BaseException:
            self._close()
            raise
        self._served = True
        return self._process

    def _close(self) -> None:
        if self._process is not None:
            self._process.close()
            self._process = None


def _nothing_between(_done: int, _total: int) -> None:
    """An empty frame has no progress."""


class _EndedError(Exception):
    """The process does not answer any more; the text says how it ended."""


class _Process:
    """A running worker. A thread reads its answers: not every platform can wait for a pipe with a timeout."""

    def __init__(self, on_layout: Progress) -> None:
        self._on_layout = on_layout
        # Output of drivers; its last line is often the only hint at the cause of a failure.
        self._errors: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115 - `close` does
        try:
            # In this process's group, so that a terminal stops and ends both.
            self._process = subprocess.Popen(
                PROGRAM,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._errors,
                cwd=child_process.ROOT,
                encoding="utf-8",
                preexec_fn=child_process.dies_with_parent(signal.SIGKILL, first_to_go=True),
            )
        except OSError as error:
            self._errors.close()
            raise CannotMeasureError(f"no process can be started to measure in: {error}") from error
        self._lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def order(self, order: Mapping[str, Any]) -> None:
        self._write(f"{json.dumps(order)}\n")

    def go_on(self) -> None:
        self._write("\n")

    def answer(self) -> dict[str, Any]:
        """The next answer. Raises _EndedError, CannotMeasureError where the process says so."""
        while "layouts_done" in (answer := self._read_answer()):
            self._on_layout(answer["layouts_done"], answer["layouts"])
        if "cannot" in answer:
            raise CannotMeasureError(answer["cannot"])
        return answer

    def close(self) -> None:
        """Kill the process."""
        self._process.kill()
        self._process.wait()
        self._reader.join()
        for stream in (self._process.stdin, self._process.stdout, self._errors):
            if stream is not None:
                with contextlib.suppress(OSError):  # buffered output has no reader
                    stream.close()

    def _read_answer(self) -> dict[str, Any]:
        line = self._line()
        if not line.endswith("\n"):
            raise _EndedError(self._ending())
        answer: dict[str, Any] = json.loads(line)
        return answer

    def _read(self) -> None:
        assert self._process.stdout is not None
        line = "\n"
        while line.endswith("\n"):
            line = self._process.stdout.readline()
            self._lines.put(line)

    def _line(self) -> str:
        # Counted in seconds of waiting: time while the machine sleeps, or this process is stopped, does not
        # count.
        for _ in range(LONGEST_SILENCE_SECONDS):
            with contextlib.suppress(queue.Empty):
                return self._lines.get(timeout=1.0)
        raise _EndedError(_silent())

    def _write(self, text: str) -> None:
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(text)
            self._process.stdin.flush()
        except OSError as error:
            raise _EndedError(self._ending()) from error

    def _ending(self) -> str:
        try:
            code = self._process.wait(timeout=LONGEST_SILENCE_SECONDS)
        except subprocess.TimeoutExpired:  # it closed its output but still runs; `close` ends it
            return _silent()
        self._errors.seek(0)
        return reasons.public_line(child_process.ending(code, self._errors.read().decode("utf-8", "replace")))


def _silent() -> str:
    return f"no answer from the device within {LONGEST_SILENCE_SECONDS} s"
