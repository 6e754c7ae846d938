"""Which version of a front a page sets beside the one it shows."""

from collections.abc import Sequence

from crowd.fronts import selectors as published
from crowd.fronts.content.difference import Difference, difference
from crowd.fronts.selectors import Front


class UnknownVersionError(ValueError):
    """No other version of that front has this name; the message lists those that there are."""


def beside(shown: Front, versions: Sequence[str], against: str) -> Difference | None:
    """SHOWN against the version called AGAINST; where that is empty, the one before it.

    VERSIONS are the names of all of them, newest first, SHOWN included. None where nothing was published
    before. Two queries. Raises UnknownVersionError.
    """
    others = [name for name in versions if name != shown.slug]
    if against and against not in others:
        there = ", ".join(others)
        raise UnknownVersionError(f"no other version {against!r} (there: {there or 'none'})")
    before = versions[versions.index(shown.slug) + 1 :]
    name = against or next(iter(before), "")
    old = published.front(name) if name else None
    return None if old is None else difference(old, shown)
