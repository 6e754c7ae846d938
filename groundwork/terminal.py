"""Output of all commands to a terminal: colours, messages with one prefix, and progress on one line.

Colours appear on a terminal only, and not where NO_COLOR is set (https://no-color.org).
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from typing import TextIO

PREFIX = "frontrunner:"
STYLES = {"error": "1;31", "warning": "1;33", "good": "1;32", "progress": "36"}  # of ANSI's SGR sequence

Progress = Callable[[int, int], None]  # called with the numbers done and in total


def styled(text: str, style: str, stream: TextIO) -> str:
    """`text` in one of STYLES, if `stream` shows colours."""
    return f"\x1b[{STYLES[style]}m{text}\x1b[0m" if has_colours(stream) else text


def has_colours(stream: TextIO) -> bool:
    """Whether `stream` is a terminal that shows colours."""
    if os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb" or not stream.isatty():
        return False
    return sys.platform != "win32" or "WT_SESSION" in os.environ  # older consoles of Windows print the codes


def fail(message: str) -> None:
    """Print an error on standard error."""
    _print(styled(PREFIX, "error", sys.stderr), message)


def warn(message: str) -> None:
    """Print a warning on standard error."""
    _print(PREFIX, f"{styled('warning:', 'warning', sys.stderr)} {message}")


def note(message: str) -> None:
    """Print a message on standard error."""
    _print(PREFIX, message)


def progress_line(label: str = "", unit: str = "frame", scale: int = 1) -> Progress | None:
    """Progress on one line of standard error, with rate and time left; None if that is not a terminal.

    Numbers are shown in `unit`, of which each is `scale` of those that the function is called with.
    """
    stream = sys.stderr
    if not stream.isatty():
        return None
    began = time.monotonic()

    def show(done: int, total: int) -> None:
        rate = done / max(time.monotonic() - began, 1e-9)
        left = f", {rate / scale:.1f} a second, {(total - done) / rate:.0f} s left" if done else ""
        text = styled(f"{label}{unit} {done // scale}/{total // scale}", "progress", stream)
        stream.write(f"\r{text}{left}\x1b[K" + ("\n" if done == total else ""))
        stream.flush()

    return show


def _print(prefix: str, message: str) -> None:
    sys.stderr.write(f"{prefix} {message}\n")
