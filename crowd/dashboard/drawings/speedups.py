"""The bar chart of the crowd."""

from dataclasses import dataclass, replace
from functools import cached_property

from django.http import HttpRequest
from django.urls import reverse

from crowd.dashboard import formats
from crowd.dashboard.content.confirmation import confirmed_first, confirmed_only, left_out
from crowd.dashboard.drawings.drawing import Drawing, Table, titled
from crowd.dashboard.figures import findings
from crowd.dashboard.figures.bar_picture import BarPicture, bar_picture
from crowd.dashboard.figures.speedups import SOC, VENDOR, speedup_bars
from crowd.devices import revision
from crowd.records.speedup import Speedup
from crowd.results.reading import selectors as results
from crowd.results.reading.backends import leading_figures
from crowd.results.reading.queries.filters import ALL
from crowd.results.reading.selectors import Speedups
from crowd.results.reading.versioned_cache import VersionedCache

DEFINITION = (
    "Speedup: time of the default configuration over time of the one shown (best, unless the title names "
    "another), on the same device. Logarithms are averaged over sessions, then over independent "
    "installations. Intervals: 95 % over independent installations, from three of them on. Means contain "
    "confirmed figures that are not suspect."
)
MEANINGS = (
    "low and high: the interval. session_low and session_high: 95 % interval of the one session behind a "
    "figure. state: confirmed once independent installations agree."
)
COLUMNS = (
    "device=device.slug", "maker=device.manufacturer", "model=device.name", "soc=device.soc",
    "gpu=device.gpu", "os=device.os", "backend", "processor", "processor_class", "front", "configuration",
    "baseline", "speedup", "low", "high", "session_low", "session_high", "sessions", "installations",
    "ate_max_m=ate_max", "state", "suspect", "last_session_at",
)  # fmt: skip
PAPER = (
    "maker", "model", "processor", "backend", "speedup", "low", "high", "sessions", "installations", "state",
)  # fmt: skip


# A picture takes up to 150 kB.
_pictures: VersionedCache[BarPicture] = VersionedCache(32)


@dataclass(frozen=True)
class Bars:
    """The crowd under filters, the rows to draw, and the criterion for colours.

    Each model has one bar, as it counts once in the mean; all configurations have one each.
    """

    crowd: Speedups
    rows: tuple[Speedup, ...]
    colour: str

    @classmethod
    def of(cls, crowd: Speedups, colour: str) -> "Bars":
        """The bars of `crowd`: those that count first."""
        several = crowd.filters.configuration == ALL
        rows = crowd.rows if several else leading_figures(crowd.rows).values()
        return cls(crowd, confirmed_first(rows), colour)

    @property
    def noun(self) -> str:
        """What a bar stands for."""
        return "figure" if self.crowd.filters.configuration == ALL else "device"

    @property
    def mean(self) -> float | None:
        """The mean of the crowd; None where its only speedup is shown as an interval."""
        return None if self.crowd.headline.range else self.crowd.headline.mean

    @property
    def counted(self) -> str:
        """How many of the bars count, and from how many sessions."""
        rows = confirmed_only(self.rows)
        sessions = formats.plural(sum(row.sessions for row in rows), "session")
        return f"{formats.plural(len(rows), self.noun)} from {sessions}"

    @cached_property
    def picture(self) -> BarPicture:
        """The bars as the server draws them, kept for each revision of figures, filters and colours."""
        key = (self.crowd.filters, self.crowd.front, self.colour, len(self.rows))
        return _pictures.get(revision.current, key, self._draw)

    def _draw(self) -> BarPicture:
        return bar_picture(self.rows, self.mean, self.colour)


def read(request: HttpRequest) -> Bars:
    """The bars for the query string."""
    return Bars.of(results.speedups(results.parse_filters(request.GET)), colour_of(request))


def embedded(bars: Bars) -> Bars:
    """The bars for other sites: only counted figures."""
    return replace(bars, rows=confirmed_only(bars.rows))


def stamp(request: HttpRequest) -> tuple[str, str, str]:
    """The cache key: filters, colours and the revision of figures."""
    return results.parse_filters(request.GET).query(), colour_of(request), revision.current()


def colour_of(request: HttpRequest) -> str:
    """The criterion ?colour=, by default the maker of the chip."""
    return SOC if request.GET.get("colour") == SOC else VENDOR


def table(bars: Bars) -> Table:
    """A row per figure, also of a model's other chips and backends: counted ones first, then by speedup."""
    return Table.of(confirmed_first(bars.crowd.rows), *COLUMNS)


def _title(bars: Bars) -> str:
    return titled("Speedup by device", bars.crowd.front, bars.crowd.filters)


def _n(bars: Bars) -> str:
    others = left_out(bars.crowd).words
    if not others:
        return bars.counted
    shown = any(not row.counts for row in bars.rows)
    return f"{bars.counted}; {'in no mean' if shown else 'not shown'}: {others}"


def finding_of(crowd: Speedups) -> str:
    """The finding about `crowd`, in one sentence."""
    filters = crowd.filters
    return findings.crowd(
        [speedup for _, speedup in crowd.models],
        crowd.headline.mean,
        filters.headline_configuration,
        left_out(crowd).devices,
        crowd.outcome_counts,
        crowd.headline.range,
    )


DRAWINGS = (
    Drawing(
        name="speedups",
        path="speedups",
        definition=DEFINITION,
        columns=MEANINGS,
        read=read,
        draw=lambda bars, theme: speedup_bars(bars.rows, theme, bars.colour, bars.mean),
        picture=lambda bars: bars.picture,
        embedded=embedded,
        table=table,
        paper=PAPER,
        title=_title,
        finding=lambda bars: finding_of(bars.crowd),
        n=_n,
        page=lambda: reverse("dashboard:devices"),
        stamp=stamp,
    ),
)
