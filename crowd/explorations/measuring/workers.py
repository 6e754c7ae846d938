"""Names of worker processes, under which they hold leases, and whether a process is alive."""

import os
import socket
from contextlib import suppress
from functools import cache
from pathlib import Path


def worker_name() -> str:
    """The name of this process: machine, boot id and process id."""
    return f"{socket.gethostname()}:{_boot()}:{os.getpid()}"


def machine_prefix() -> str:
    """The prefix of the names of this machine's processes, including those before its last boot."""
    return f"{socket.gethostname()}:"


def is_alive(worker: str) -> bool:
    """Whether `worker`, a process of this machine, still runs. True if its name does not tell."""
    machine, _, pid = worker.rpartition(":")
    if not pid.isdecimal():
        return True
    if machine != worker_name().rpartition(":")[0]:
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
    """The boot id, if the system has one: process ids are reused after a boot."""
    with suppress(OSError):
        return Path("/proc/sys/kernel/random/boot_id").read_text().strip().partition("-")[0]
    return ""
