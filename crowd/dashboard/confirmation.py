"""What pages say about confirmed and unconfirmed figures: in which order they stand, and what is left out."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from django.conf import settings

from crowd.dashboard import formats
from crowd.results.reading.aggregates import preferred_figures
from crowd.results.reading.rows import Speedup
from crowd.results.reading.selectors import Speedups

# How many independent installations the crowd's figures need; a private server may ask for fewer.
STANDARD_QUORUM = 3
NUMBERS = {1: "one", 2: "two", 3: "three"}


@dataclass(frozen=True)
class LeftOut:
    """The device models that were measured and are in no mean, because no figure of them counts.

    Some are `unconfirmed`, the others `suspect`. `smallest` and `largest` are the range of their speedups,
    None without a model. `only`: the figure, where there is exactly one model.
    """

    unconfirmed: int
    suspect: int
    sessions: int
    smallest: float | None
    largest: float | None
    only: Speedup | None

    @property
    def devices(self) -> int:
        return self.unconfirmed + self.suspect

    @property
    def words(self) -> str:
        """How many there are of each kind: "2 unconfirmed devices and 1 suspect device"; "" for none."""
        kinds = ((self.unconfirmed, "unconfirmed device"), (self.suspect, "suspect device"))
        return " and ".join(formats.plural(count, noun) for count, noun in kinds if count)


def left_out(crowd: Speedups) -> LeftOut:
    """The device models of CROWD that its headline leaves out."""
    shown = [row for row in crowd.rows if row.configuration == crowd.filters.headline_configuration]
    counted = {row.device.slug for row in shown if row.counts}
    rows = preferred_figures([row for row in shown if row.device.slug not in counted])
    devices = {row.device.slug for row in rows}
    # A model with a figure that only lacks confirmation is unconfirmed, whatever else it has.
    unconfirmed = {row.device.slug for row in rows if not row.suspect}
    speedups = [row.speedup for row in rows]
    return LeftOut(
        unconfirmed=len(unconfirmed),
        suspect=len(devices - unconfirmed),
        sessions=sum(row.sessions for row in rows),
        smallest=min(speedups, default=None),
        largest=max(speedups, default=None),
        only=rows[0] if len(devices) == 1 else None,
    )


def ordered(rows: Iterable[Speedup]) -> tuple[Speedup, ...]:
    """ROWS with the figures that count first, each part in its own order.

    Anyone can send a large unconfirmed figure: none stands above a confirmed one.
    """
    return tuple(sorted(rows, key=lambda row: not row.counts))


def confirmed_only(rows: Iterable[Speedup]) -> tuple[Speedup, ...]:
    """Those of ROWS that count, in their order."""
    return tuple(row for row in rows if row.counts)


def unconfirmed(rows: Sequence[Speedup]) -> int:
    """How many of ROWS wait for confirmation; suspect ones are another matter."""
    return sum(not row.confirmed and not row.suspect for row in rows)


def confirmed_by_chip(figure: Speedup | None) -> bool:
    """Whether installations of other models with the same chip confirmed FIGURE: its own are too few."""
    if figure is None or figure.device.simulated or not figure.confirmed:
        return False
    return figure.installations < settings.FRONTRUNNER_QUORUM


def requirement() -> str:
    """What confirms a figure on this server: "three independent installations have to agree"."""
    quorum = max(settings.FRONTRUNNER_QUORUM, 1)
    if quorum == 1:
        return "one independent installation has to measure it"
    return f"{NUMBERS.get(quorum, quorum)} independent installations have to agree"


def private_notice() -> str:
    """What a private server says on its pages; "" where it asks for as many as others."""
    quorum = settings.FRONTRUNNER_QUORUM
    if quorum >= STANDARD_QUORUM:
        return ""
    return f"This server confirms a figure with {formats.plural(quorum, 'installation')}."
