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
LONGEST_FRAME_SECONDS = 180
# Of one step before the first frame, in which the driver compiles: minutes on slow boards.
COMPILING_MINUTES = 30
MINUTE = 60  # seconds

# Called with the numbers of frames done and in total.
Progress = Callable[[int, int], None]
# Called with what is done, and the numbers of steps done and in total.
Preparing = Callable[[str, int, int], None]


class FailedError(Exception):
    """This configuration does not run here; the text is the reason, without private data.

    `silent`: nothing answered in time, and a second attempt would take as long.
    """

    def __init__(self, reason: str, *, silent: bool = False) -> None:
        super().__init__(reason)
        self.silent = silent


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

    `device` is the label of a device of `backend`. `preparing` is called between the steps in which the
    driver compiles; one that takes longer than `compiling_minutes` is given up.
    """

    def __init__(
        self,
        application: str,
        sequence: Path,
        device: str,
        backend: str,
        preparing: Preparing,
        compiling_minutes: int = COMPILING_MINUTES,
    ) -> None:
        self._setting = {
            "application": application,
            "sequence": str(sequence.absolute()),
            "device": device,
            "backend": backend,
        }
        self._preparing = preparing
        self._compiling_minutes = compiling_minutes
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
        report = answer["report"]
        return Outcome(report, answer["positions"], report["cpu_us"], report["waited_us"])

    def _answer(self, order: Mapping[str, Any], between_frames: Progress) -> dict[str, Any]:
        process = self._process or self._open()
        try:
            process.order(order)
            answer = process.answer(compiling=True)
            while "done" in answer:
                between_frames(answer["done"], answer["total"])
                process.go_on()
                answer = process.answer(compiling=False)
        except _EndedError as error:
            self._close()
            raise BrokenError(str(error), silent=error.silent) from error
        except BaseException:
            self._close()  # it still runs a measurement that was abandoned
            raise
        if "failure" in answer:
            raise FailedError(answer["failure"])
        return answer

    def _open(self) -> "_Process":
        try:
            self._process = _Process(self._preparing, self._compiling_minutes, self._setting["backend"])
            self._process.order(self._setting)
            self._process.answer(compiling=True)
        except _EndedError as error:
            self._close()
            raise DeviceBrokenError(str(error), silent=error.silent) from error
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
    """The process does not answer any more; the text says how it ended. `silent`: it did not end."""

    def __init__(self, reason: str, *, silent: bool = False) -> None:
        super().__init__(reason)
        self.silent = silent


class _Process:
    """A running worker. A thread reads its answers: not every platform can wait for a pipe with a timeout."""

    def __init__(self, preparing: Preparing, compiling_minutes: int, backend: str) -> None:
        self._preparing, self._compiling_minutes, self._backend = preparing, compiling_minutes, backend
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

    def answer(self, *, compiling: bool) -> dict[str, Any]:
        """The next answer; `compiling`: the driver may compile before it.

        Raises _EndedError, CannotMeasureError where the process says so.
        """
        while "preparing" in (answer := self._read_answer(compiling)):
            self._preparing(answer["preparing"], answer["done"], answer["total"])
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

    def _read_answer(self, compiling: bool) -> dict[str, Any]:
        line = self._line(compiling)
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

    def _line(self, compiling: bool) -> str:
        # Counted in seconds of waiting: time while the machine sleeps, or this process is stopped, does not
        # count.
        for _ in range(MINUTE * self._compiling_minutes if compiling else LONGEST_FRAME_SECONDS):
            with contextlib.suppress(queue.Empty):
                return self._lines.get(timeout=1.0)
        raise _EndedError(self._slow_compiler() if compiling else _silent(), silent=True)

    def _slow_compiler(self) -> str:
        minutes = self._compiling_minutes
        other = "" if self._backend == "wasm" else ", or measure the processor with --backend wasm"
        return (
            f"the device's compiler did not answer within {minutes} min: "
            f"allow more with --compiling-minutes {2 * minutes}{other}"
        )

    def _write(self, text: str) -> None:
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(text)
            self._process.stdin.flush()
        except OSError as error:
            raise _EndedError(self._ending()) from error

    def _ending(self) -> str:
        try:
            code = self._process.wait(timeout=LONGEST_FRAME_SECONDS)
        except subprocess.TimeoutExpired:  # it closed its output but still runs; `close` ends it
            return _silent()
        self._errors.seek(0)
        return reasons.public_line(child_process.ending(code, self._errors.read().decode("utf-8", "replace")))


def _silent() -> str:
    return f"no answer from the device within {LONGEST_FRAME_SECONDS} s"
