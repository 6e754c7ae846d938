"""Processes that measure, by the names under which they hold leases, and whether one still lives."""

import os
import socket
from contextlib import suppress
from functools import cache
from pathlib import Path


def here() -> str:
    """This process as a holder of leases: its machine, which start of it, and its number there."""
    return f"{socket.gethostname()}:{_boot()}:{os.getpid()}"


def of_this_machine() -> str:
    """What the names of this machine's processes begin with, those before its last start among them."""
    return f"{socket.gethostname()}:"


def alive(worker: str) -> bool:
    """Whether a process of this machine still runs, as far as its name says."""
    machine, _, pid = worker.rpartition(":")
    if not pid.isdecimal():
        return True
    if machine != here().rpartition(":")[0]:
        return False
    try:
        os.kill(int(pid), 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True


@cache
def _boot() -> str:
    """What tells this start of the machine from others, where the system says so: numbers come again."""
    with suppress(OSError):
        return Path("/proc/sys/kernel/random/boot_id").read_text().strip().partition("-")[0]
    return ""
