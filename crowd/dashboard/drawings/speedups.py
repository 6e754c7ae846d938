"""The crowd's bars."""

from dataclasses import dataclass

from django.http import HttpRequest
from django.urls import reverse

from crowd.dashboard import formats
from crowd.dashboard.drawings.drawing import Drawing, Table, titled
from crowd.dashboard.figures.speedups import SOC, VENDOR, speedup_bars
from crowd.devices import revision
from crowd.results.reading import selectors as results
from crowd.results.reading.rows import Speedup
from crowd.results.reading.selectors import Speedups

DEFINITION = (
    "Speedup: time of the default configuration over time of the one shown (best, unless the title names "
    "another), on the same device, averaged over sessions and installations by logarithms. low and high: "
    "95 % interval over installations, from three of them on."
)
COLUMNS = (
    "device", "maker", "model", "soc", "gpu", "os", "backend", "processor", "front", "configuration",
    "baseline", "speedup", "low", "high", "sessions", "installations", "ate_max_m", "state",
    "last_session_at",
)  # fmt: skip


@dataclass(frozen=True)
class Bars:
    """The crowd under filters, and what its bars are coloured by."""

    crowd: Speedups
    colour: str


def read(request: HttpRequest) -> Bars:
    """The bars that the query string asks for."""
    return Bars(results.speedups(results.asked(request.GET)), colour_of(request))


def stamp(request: HttpRequest) -> tuple[str, str, str]:
    """What is asked for, and how the crowd is: two thousand bars take a while to draw."""
    return results.asked(request.GET).query(), colour_of(request), revision.current()


def colour_of(request: HttpRequest) -> str:
    """What ?colour= names; whose chip computed where it names nothing known."""
    return SOC if request.GET.get("colour") == SOC else VENDOR


def table(bars: Bars) -> Table:
    """A row for each bar, fastest first."""
    return Table(COLUMNS, [_cells(row) for row in bars.crowd.rows])


def _cells(row: Speedup) -> tuple[str | float | int | None, ...]:
    device = row.device
    return (
        device.slug, device.manufacturer, device.name, device.soc, device.gpu, device.os, row.backend,
        row.processor, row.front, row.configuration, row.baseline, row.speedup, row.low, row.high,
        row.sessions, row.installations, row.ate_max, "suspect" if row.suspect else "valid",
        row.last_session_at.isoformat(),
    )  # fmt: skip


def _title(bars: Bars) -> str:
    return titled("Speedup by device", bars.crowd.front, bars.crowd.filters)


def _n(bars: Bars) -> str:
    crowd = bars.crowd
    figures = formats.plural(len(crowd.rows), "figure")
    return f"{figures} from {formats.plural(crowd.headline.sessions, 'session')}"


DRAWINGS = (
    Drawing(
        name="speedups",
        path="speedups",
        definition=DEFINITION,
        read=read,
        draw=lambda bars, theme: speedup_bars(bars.crowd.rows, theme, bars.colour),
        table=table,
        title=_title,
        n=_n,
        page=lambda: reverse("dashboard:devices"),
        stamp=stamp,
        simulated=lambda bars: bars.crowd.filters.simulated,
    ),
)
