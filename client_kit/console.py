"""Output for participants: lines on standard output, and a progress bar on a terminal."""

import io
import os
import sys
import time
from collections.abc import Iterable
from contextlib import suppress
from typing import TextIO

from groundwork.terminal import styled

WIDTH = 30
REDRAW_SECONDS = 0.1
HIGHLIGHTED = {"Note:": "warning", "Stop:": "error", "Speedup": "good"}  # first words, with their style


class NullStream(io.StringIO):
    """A stream that discards everything."""

    def write(self, text: str) -> int:
        return len(text)


class Console:
    """Lines for people. The bar is redrawn in place on a terminal and left out elsewhere, as in a log.

    When the reader of the stream is gone, it writes nothing more, and the work goes on.
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        self._stream = stream if stream is not None else sys.stdout
        if isinstance(self._stream, io.TextIOWrapper):
            # A device's name may hold characters that an old terminal cannot show: they are replaced.
            self._stream.reconfigure(errors="replace")
        self._bars = self._stream.isatty()
        self._drawn = 0
        self._drawn_at = 0.0

    @property
    def silent(self) -> bool:
        """Whether output is discarded."""
        return isinstance(self._stream, NullStream)

    @property
    def can_ask(self) -> bool:
        """Whether somebody at a terminal can answer."""
        return not self.silent and sys.stdin.isatty()

    def say(self, line: str = "") -> None:
        """Write one line, in place of a bar if one is shown."""
        self._wipe()
        word, space, rest = line.partition(" ")
        if word in HIGHLIGHTED:
            word = styled(word, HIGHLIGHTED[word], self._stream)
        self._write(f"{word}{space}{rest}\n")

    def lines(self, lines: Iterable[str]) -> None:
        """Write several lines."""
        for line in lines:
            self.say(line)

    def bar(self, label: str, done: int, total: int, unit: str = "", left: float | None = None) -> None:
        """Show progress and, where known, the seconds left."""
        now = time.monotonic()
        if not self._bars or (done < total and now - self._drawn_at < REDRAW_SECONDS):
            return
        filled = WIDTH * done // total if total else WIDTH
        line = f"{label} [{'#' * filled}{'.' * (WIDTH - filled)}] {done}/{total}{unit}"
        if left is not None:
            line += f" {int(left) // 60}:{int(left) % 60:02} left"
        self._wipe()
        self._write(styled(line, "progress", self._stream))
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
            # Otherwise Python fails again when it closes the stream. A stream without a file raises OSError.
            with suppress(OSError):
                os.dup2(os.open(os.devnull, os.O_WRONLY), self._stream.fileno())
            self._stream = NullStream()
