"""Confirmed and unconfirmed figures on pages: their order, and those that means leave out."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from django.conf import settings
from django.utils.translation import gettext, ngettext

from crowd.dashboard import formats
from crowd.records.speedup import Speedup
from crowd.results.reading.aggregates import preferred_figures
from crowd.results.reading.selectors import Speedups

# The usual number of independent installations behind a confirmed figure; private servers may need fewer.
STANDARD_QUORUM = 3
NUMBERS = {2: "two", 3: "three"}


@dataclass(frozen=True)
class LeftOut:
    """The measured device models without a counted figure, which means leave out.

    They are `unconfirmed` or `suspect`. `only`: the figure, if there is exactly one model.
    """

    unconfirmed: int
    suspect: int
    only: Speedup | None

    @property
    def devices(self) -> int:
        return self.unconfirmed + self.suspect

    @property
    def words(self) -> str:
        """The counts in words: "2 unconfirmed devices and 1 suspect device"; "" for none."""
        kinds = ((self.unconfirmed, "unconfirmed device"), (self.suspect, "suspect device"))
        return " and ".join(formats.plural(count, noun) for count, noun in kinds if count)


def left_out(crowd: Speedups) -> LeftOut:
    """The device models that the headline of `crowd` leaves out."""
    shown = [row for row in crowd.rows if row.configuration == crowd.filters.headline_configuration]
    counted = {row.device.slug for row in shown if row.counts}
    rows = preferred_figures([row for row in shown if row.device.slug not in counted])
    devices = {row.device.slug for row in rows}
    # A model with an unconfirmed and a suspect figure is unconfirmed.
    unconfirmed = {row.device.slug for row in rows if not row.suspect}
    return LeftOut(
        unconfirmed=len(unconfirmed),
        suspect=len(devices - unconfirmed),
        only=rows[0] if len(devices) == 1 else None,
    )


def confirmed_first(rows: Iterable[Speedup]) -> tuple[Speedup, ...]:
    """`rows` with counted figures first; the order is otherwise unchanged.

    Anyone can send a large unconfirmed figure, so none is placed above a confirmed one.
    """
    return tuple(sorted(rows, key=lambda row: not row.counts))


def confirmed_only(rows: Iterable[Speedup]) -> tuple[Speedup, ...]:
    """The counted figures of `rows`, in order."""
    return tuple(row for row in rows if row.counts)


def unconfirmed(rows: Sequence[Speedup]) -> int:
    """The number of unconfirmed figures in `rows`, without suspect ones."""
    return sum(not row.confirmed and not row.suspect for row in rows)


def confirmed_by_chip(figure: Speedup | None) -> bool:
    """Whether `figure` is confirmed only with installations of other models with the same chip."""
    if figure is None or not figure.confirmed:
        return False
    return figure.installations < settings.FRONTRUNNER_QUORUM


def requirement() -> str:
    """The condition for a confirmed figure: "three independent installations have to agree"."""
    quorum = max(settings.FRONTRUNNER_QUORUM, 1)
    if quorum == 1:
        return gettext("one independent installation has to measure it")
    number = gettext(NUMBERS[quorum]) if quorum in NUMBERS else quorum
    return gettext("%(number)s independent installations have to agree") % {"number": number}


def private_notice() -> str:
    """The notice on pages of a private server; "" if it uses the standard quorum."""
    quorum = settings.FRONTRUNNER_QUORUM
    if quorum >= STANDARD_QUORUM:
        return ""
    return ngettext(
        "This server confirms a figure with %(quorum)s\N{NO-BREAK SPACE}installation.",
        "This server confirms a figure with %(quorum)s\N{NO-BREAK SPACE}installations.",
        quorum,
    ) % {"quorum": quorum}
