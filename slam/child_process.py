"""Child processes that measure: they end with their parent, and their end becomes a reason."""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path

from slam.public_text import one_line

ROOT = Path(__file__).resolve().parents[1]  # the folder in which `python -m slam` finds its packages
PR_SET_PDEATHSIG = 1


def dies_with_parent(with_signal: signal.Signals, first_to_go: bool = False) -> Callable[[], None] | None:
    """A function for a child to run before its program: it gets `with_signal` when this process ends.

    `first_to_go` makes it the system's first choice when memory runs out. Both need Linux: elsewhere None.
    """
    if not sys.platform.startswith("linux"):
        return None
    parent = os.getpid()
    libc = ctypes.CDLL(None, use_errno=True)

    def in_child() -> None:
        libc.prctl(PR_SET_PDEATHSIG, with_signal)
        if os.getppid() != parent:  # it ended before the line above
            os._exit(1)
        if first_to_go:
            with contextlib.suppress(OSError), open("/proc/self/oom_score_adj", "w") as file:
                file.write("1000")

    return in_child


def ending(code: int, errors: str) -> str:
    """The reason of a process's end from its exit `code` and its last line on standard error."""
    last = last_line(errors)
    if code < 0:
        with contextlib.suppress(ValueError):
            name = signal.Signals(-code).name
            likely = " (as the system does when memory runs out)" if name == "SIGKILL" else ""
            return one_line(f"killed by {name}{likely}: {last}")
    return one_line(f"exit code {code}: {last}")


def last_line(errors: str) -> str:
    """The last line of standard error, or a note that it is empty."""
    lines = errors.strip().splitlines()
    return lines[-1] if lines else "nothing on its error output"
