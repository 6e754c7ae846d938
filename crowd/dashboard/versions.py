"""Which version of a front a page sets beside the one it shows."""

from collections.abc import Sequence

from crowd.fronts.content.difference import Difference, difference
from crowd.fronts.selectors import Front


class UnknownVersionError(ValueError):
    """No other version of that front has this name; the message lists those that there are."""


def beside(shown: Front, others: Sequence[Front], against: str) -> Difference | None:
    """SHOWN against the one of OTHERS (newest first) called AGAINST; where that is empty, the one before it.

    None where nothing was published before. Raises UnknownVersionError.
    """
    if against:
        chosen = next((front for front in others if front.slug == against), None)
        if chosen is None:
            there = ", ".join(front.slug for front in others)
            raise UnknownVersionError(f"no other version {against!r} (there: {there or 'none'})")
    else:
        chosen = next((front for front in others if _published(front) < _published(shown)), None)
    return None if chosen is None else difference(chosen, shown)


def _published(front: Front) -> float:
    assert front.published_at is not None  # only what was published is shown
    return front.published_at.timestamp()
