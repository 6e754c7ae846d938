"""Files that the manifest names by their digest: fetched once, checked, and kept."""

import hashlib
import time
from collections.abc import Callable
from pathlib import Path

from client_kit.delivery.server import ProblemError, Server, UnreachableError
from client_kit.errors import CannotMeasureError

ATTEMPTS = 4
FIRST_PAUSE_SECONDS = 1.0


class CorruptDownloadError(CannotMeasureError):
    """A file arrived complete, but its digest is not the manifest's."""


def fetch(
    server: Server,
    url: str,
    sha256: str,
    size: int | None = None,
    pause: Callable[[float], None] = time.sleep,
) -> bytes:
    """The file at URL, of `size` bytes where that is known, with this digest.

    Raises CorruptDownloadError, or the server's errors when the file does not come in ATTEMPTS attempts.
    """
    for attempt in range(ATTEMPTS):
        last = attempt == ATTEMPTS - 1
        try:
            data = server.download(url, size)
        except UnreachableError:
            if last:
                raise
            wait = None
        except ProblemError as problem:
            if last or not problem.temporary:
                raise
            wait = problem.retry_after
        else:
            if hashlib.sha256(data).hexdigest() == sha256:
                return data
            wait = None
        if not last:
            pause(FIRST_PAUSE_SECONDS * 2**attempt if wait is None else wait)
    raise CorruptDownloadError(
        f"{url} does not match the manifest (sha256 {sha256[:12]}...): "
        "something between here and the server changes it; try another network"
    )


def matches_digest(path: Path, sha256: str) -> bool:
    """Whether the file at `path` has this digest; False for a missing or unreadable file."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest() == sha256
    except OSError:
        return False
