"""What a participant sees: lines on standard output, a progress bar where the terminal can show one."""

import io
import os
import sys
import time
from collections.abc import Iterable
from contextlib import suppress
from typing import TextIO

WIDTH = 30
REDRAW_SECONDS = 0.1


class Silence(io.StringIO):
    """A stream that keeps nothing."""

    def write(self, text: str) -> int:
        return len(text)


class Console:
    """Lines for people. The bar is redrawn in place on a terminal and left out elsewhere, as in a log.

    It falls silent when whoever read the lines is gone: what is told of goes on.
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        self._stream = stream if stream is not None else sys.stdout
        if isinstance(self._stream, io.TextIOWrapper):
            # A device's name may hold what an old terminal cannot show; that is no reason to stop.
            self._stream.reconfigure(errors="replace")
        self._bars = self._stream.isatty()
        self._drawn = 0
        self._drawn_at = 0.0

    @property
    def silent(self) -> bool:
        """Whether nobody sees what is said."""
        return isinstance(self._stream, Silence)

    def say(self, line: str = "") -> None:
        """Write one line, in place of a bar if one is shown."""
        self._wipe()
        self._write(f"{line}\n")

    def lines(self, lines: Iterable[str]) -> None:
        """Write several lines."""
        for line in lines:
            self.say(line)

    def bar(self, label: str, done: int, total: int, unit: str = "", left: float | None = None) -> None:
        """Show how far something is, and for how many seconds all of it goes on, where that is known."""
        now = time.monotonic()
        if not self._bars or (done < total and now - self._drawn_at < REDRAW_SECONDS):
            return
        filled = WIDTH * done // total if total else WIDTH
        line = f"{label} [{'#' * filled}{'.' * (WIDTH - filled)}] {done}/{total}{unit}"
        if left is not None:
            line += f" {int(left) // 60}:{int(left) % 60:02} left"
        self._wipe()
        self._write(line)
        self._drawn, self._drawn_at = len(line), now

    def ask(self, question: str) -> bool:
        """Whether the participant types yes."""
        self._wipe()
        self._write(f"{question} [yes/no] ")
        return sys.stdin.readline().strip().lower() in ("y", "yes")

    def _wipe(self) -> None:
        if self._drawn:
            self._write(f"\r{' ' * self._drawn}\r")
            self._drawn = 0

    def _write(self, text: str) -> None:
        try:
            self._stream.write(text)
            self._stream.flush()
        except BrokenPipeError:
            with suppress(OSError):  # a stream without a file; else Python fails on it again at the end
                os.dup2(os.open(os.devnull, os.O_WRONLY), self._stream.fileno())
            self._stream = Silence()
