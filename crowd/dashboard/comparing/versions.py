"""Comparison of a front with another version."""

from collections.abc import Sequence

from crowd.fronts import selectors as published
from crowd.fronts.content.difference import Difference, difference
from wire.front import Front


class UnknownVersionError(ValueError):
    """There is no other version with this name; the message lists the existing ones."""


def compare_versions(shown: Front, versions: Sequence[str], against: str) -> Difference | None:
    """Compare `shown` with the version `against`, by default with the previous one.

    `versions` are all versions, newest first, including `shown`. None if `shown` is the first one. Two
    queries. Raises UnknownVersionError.
    """
    others = [name for name in versions if name != shown.slug]
    if against and against not in others:
        choices = ", ".join(others)
        raise UnknownVersionError(f"no other version {against!r}: choose from {choices or 'none'}")
    before = versions[versions.index(shown.slug) + 1 :]
    name = against or next(iter(before), "")
    old = published.front(name) if name else None
    return None if old is None else difference(old, shown)
