"""Whether this server is a demo. All other code asks here.

The mark is in the database, so it moves with it: into a backup, another folder, another process.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

from django.http import HttpRequest

from crowd.demo.models import DemoMark

SENTENCE = "This server is a demo: its devices do not exist, and all figures are simulated."
REFUSAL = "This server is a demo: it takes no measurements. Measure for another server."

_admitting = False


def is_demo() -> bool:
    """Whether all data of this server is simulated. One query in each process: it never changes."""
    return _is_marked()


@cache
def _is_marked() -> bool:
    return DemoMark.objects.exists()


def write() -> None:
    """Mark the database, which must be empty, as that of a demo server."""
    DemoMark.objects.create(pk=1)
    _is_marked.cache_clear()


def file_name(name: str) -> str:
    """`name` of a download. On a demo server it says so before its ending, because a CSV file cannot."""
    stem, dot, ending = name.partition(".")
    return f"{stem}-simulated{dot}{ending}" if is_demo() else name


def refuses_clients() -> bool:
    """Whether a new client is refused: on a demo server, unless this process fills it."""
    return is_demo() and not _admitting


@contextmanager
def admitting() -> Iterator[None]:
    """Admit the simulated devices that this process is about to send."""
    global _admitting
    _admitting = True
    try:
        yield
    finally:
        _admitting = False


def context(request: HttpRequest) -> dict[str, bool]:  # noqa: ARG001 - as Django calls it
    """What every template knows: `demo`."""
    return {"demo": is_demo()}
