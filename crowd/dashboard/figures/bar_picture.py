"""The bars of the crowd as SVG that the server writes: seen at once, without a script, at any width.

Widths are percentages and heights pixels, so that one picture fits a phone and a desk. style.css has the
colours of its classes, and shows names from the width on at which they fit.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape

from django.urls import reverse
from django.utils.safestring import SafeString, mark_safe

from crowd.dashboard import formats
from crowd.dashboard.figures.elements.decimation import decimate, decimation_note
from crowd.dashboard.figures.elements.layout import clipped, count_words, interval_words, state_words
from crowd.dashboard.figures.elements.names import short_names
from crowd.dashboard.figures.speedups import GREYS, SOC, bar_groups, bar_names, in_order, round_ticks
from crowd.records.speedup import Speedup

FLAT = 12  # most bars that lie flat, with the whole name above each
FEW, NAMED = 40, 90  # most names below upright bars on a narrow and on a wide desk
MOST_BARS = 400  # more would weigh more than the page
MOST_WHISKERS = 120  # more only blur the picture
NAME_LENGTH, TITLE_LENGTH = 30, 44
PLOT = 92.0  # per cent of the width; the numbers of the axis are beside it
TOP, BOTTOM, NAMES = 30.0, 286.0, 176.0  # pixels, of upright bars and of the names below
ROW, BAR = 60.0, 14.0  # pixels, of flat bars


@dataclass(frozen=True)
class BarPicture:
    """The drawing, and the groups that its colours mean, each with its class.

    `note`: how many bars are drawn, if not all.
    """

    svg: SafeString
    groups: tuple[tuple[str, str], ...]
    note: str


@dataclass(frozen=True)
class _Bar:
    row: Speedup
    name: str
    short: str
    colour: str

    @property
    def ends(self) -> tuple[float, float]:
        """The interval, else that of the one session, else the value twice."""
        low, high = self.row.low, self.row.high
        if low is None or high is None:
            low, high = self.row.session_low, self.row.session_high
        return (self.row.speedup,) * 2 if low is None or high is None else (low, high)


def bar_picture(rows: Sequence[Speedup], mean: float | None, by: str) -> BarPicture:
    """A bar for each of `rows`: those that count first, the largest gain first.

    A line at no gain; across upright bars one at `mean`. Unconfirmed bars are hollow and suspect ones
    striped. They do not change the scale. `by`: what colours mean, VENDOR or SOC.
    """
    ranked = in_order(rows)
    drawn = decimate(ranked, lambda _: False, MOST_BARS)
    groups, shown = bar_groups(drawn, by)
    classes = {name: _class(name, number, by) for number, name in enumerate(shown, 1)}
    shorts = short_names([row.device for row in drawn], NAME_LENGTH)
    bars = [
        _Bar(row, name, short, classes[group])
        for row, name, short, group in zip(drawn, bar_names(drawn), shorts, groups, strict=True)
    ]
    in_sight = [bar for bar in bars if bar.row.counts] or bars
    top = max([*(bar.ends[1] for bar in in_sight), mean or 1.0, 1.4]) * 1.03
    lines = _flat(bars, top) if len(bars) <= FLAT else _upright(bars, top, mean)
    return BarPicture(
        svg=mark_safe("\n".join(lines)),
        groups=tuple(classes.items()) if len(classes) > 1 else (),
        note=decimation_note(len(drawn), len(ranked)),
    )


def _class(group: str, number: int, by: str) -> str:
    """The class of a `group`, the `number`-th (from 1)."""
    if by == SOC and group not in GREYS:
        return f"series-{number}"
    return f"family-{GREYS.get(group, group).lower()}"


def _flat(bars: Sequence[_Bar], top: float) -> Iterator[str]:
    """Lines of an SVG with a flat bar for each of `bars`, its name and chip above it."""
    bottom = ROW * max(len(bars), 1)
    yield _opening("flat", bottom + 24)
    for tick in round_ticks(top, 5):
        x = PLOT * tick / top
        anchor = "" if tick else " start"
        yield f'<line class="grid" x1="{x:.2f}%" x2="{x:.2f}%" y2="{bottom:.0f}"/>'
        yield f'<text class="tick{anchor}" x="{x:.2f}%" y="{bottom + 18:.0f}">{tick:g}{formats.TIMES}</text>'
    x = PLOT / top
    yield f'<line class="no-gain" x1="{x:.2f}%" x2="{x:.2f}%" y2="{bottom:.0f}"/>'
    for number, bar in enumerate(bars):
        y = ROW * number + 38
        row, (low, high) = bar.row, (PLOT * min(end, top) / top for end in bar.ends)
        yield from _link(bar)
        value = formats.speedup(row.speedup, row.range)
        yield f'<text x="0" y="{y - 21:.0f}"><tspan class="value">{value}</tspan> '
        yield f"{escape(clipped(bar.name, TITLE_LENGTH))}</text>"
        chip = ", ".join(filter(None, [row.processor, *state_words(row)]))
        yield f'<text class="chip" x="0" y="{y - 6:.0f}">{escape(chip)}</text>'
        place = f'y="{y:.0f}" width="{PLOT * min(row.speedup, top) / top:.2f}%" height="{BAR:.0f}"'
        yield from _shapes(bar, place)
        yield f'<line class="{_whisker(row)}" x1="{low:.2f}%" x2="{high:.2f}%" y1="{y + BAR / 2:.0f}"'
        yield f' y2="{y + BAR / 2:.0f}"/></a>'
    yield "</svg>"


def _upright(bars: Sequence[_Bar], top: float, mean: float | None) -> Iterator[str]:
    """Lines of an SVG with an upright bar for each of `bars`, and the names of the first and last that count.

    Names of all are below where they fit.
    """

    ticks = round_ticks(top, 6)
    if ticks[-1] < top:
        # No interval leaves the axis.
        ticks.append(ticks[-1] + ticks[1])

    def height(value: float) -> float:
        return BOTTOM - (BOTTOM - TOP) * min(value / ticks[-1], 1.0)

    counted = sum(bar.row.counts for bar in bars)
    # A gap parts those that do not count from those that do.
    places = [number + (number >= counted > 0) for number in range(len(bars))]
    pitch = PLOT / (places[-1] + 1)
    named = len(bars) <= NAMED
    kind = "upright" if not named else "upright few-names" if len(bars) <= FEW else "upright many-names"
    yield _opening(kind, BOTTOM + NAMES if named else BOTTOM + 8)
    for tick in ticks:
        y = height(tick)
        yield f'<line class="grid" x2="{PLOT}%" y1="{y:.1f}" y2="{y:.1f}"/>'
        yield f'<text class="tick" x="100%" y="{y + 4:.1f}">{tick:g}{formats.TIMES}</text>'
    for bar, place in zip(bars, places, strict=True):
        middle, y = (place + 0.4) * pitch, height(bar.row.speedup)
        yield from _link(bar)
        yield from _shapes(
            bar,
            f'x="{place * pitch:.2f}%" y="{y:.1f}" width="{pitch * 0.8:.2f}%" height="{BOTTOM - y:.1f}"',
        )
        if len(bars) <= MOST_WHISKERS and bar.ends[0] != bar.ends[1]:
            low, high = map(height, bar.ends)
            yield f'<line class="{_whisker(bar.row)}" x1="{middle:.2f}%" x2="{middle:.2f}%"'
            yield f' y1="{low:.1f}" y2="{high:.1f}"/>'
        if named:
            yield f'<svg class="name" x="{middle:.2f}%" y="{BOTTOM + 8:.0f}">'
            yield f'<text transform="rotate(58)">{escape(bar.short)}</text></svg>'
        yield "</a>"
    yield f'<line class="no-gain" x2="{PLOT}%" y1="{height(1):.1f}" y2="{height(1):.1f}"/>'
    last = (counted or len(bars)) - 1
    tips = [height(bar.ends[1]) for bar in bars[: last + 1]]
    middle, end = (last + 0.4) * pitch, (last + 0.8) * pitch
    level = tips[last]
    if mean is not None:
        y = height(mean)
        level = min(level, y)
        yield f'<line class="mean" x2="{end:.2f}%" y1="{y:.1f}" y2="{y:.1f}"/>'
        # Left of the line from the label above it.
        yield f'<text class="label end" x="{middle:.2f}%" dx="-6" y="{y - 6:.1f}">mean '
        yield f'<tspan class="value">{formats.speedup(mean)}</tspan></text>'
    # Above all intervals, because labels are wider than bars.
    crest = min(tips) - 9
    yield f'<text class="label" x="0" y="{crest:.1f}">{_label(bars[0], "largest")}</text>'
    yield _lead(0.4 * pitch, crest, tips[0])
    level -= 28
    yield f'<text class="label end" x="{end:.2f}%" y="{level:.1f}">{_label(bars[last], "smallest")}</text>'
    yield f"{_lead(middle, level, tips[last])}</svg>"


def _lead(x: float, label: float, tip: float) -> str:
    """A line from the baseline of a `label` to the `tip` of its bar."""
    return f'<line class="lead" x1="{x:.2f}%" x2="{x:.2f}%" y1="{label + 4:.1f}" y2="{tip - 3:.1f}"/>'


def _opening(kind: str, height: float) -> str:
    stripes = (
        '<defs><pattern id="stripes" width="6" height="6" patternUnits="userSpaceOnUse" '
        'patternTransform="rotate(45)"><rect width="2.5" height="6" class="stripe"/></pattern></defs>'
    )
    size = f'width="100%" height="{height:.0f}"'
    return f'<svg class="bars {kind}" {size} aria-hidden="true" focusable="false">{stripes}'


def _link(bar: _Bar) -> Iterator[str]:
    """The opening of a link to the device, with what a pointer that rests on the bar shows."""
    row = bar.row
    figures = [
        formats.speedup(row.speedup, row.range),
        *interval_words(row),
        count_words(row),
        *state_words(row),
    ]
    yield f'<a href="{reverse("dashboard:device", args=[row.device.slug])}" tabindex="-1">'
    words = "\n".join([bar.name, *figures])
    yield f"<title>{escape(words)}</title>"


def _shapes(bar: _Bar, place: str) -> Iterator[str]:
    """The bar at `place`; a suspect one with stripes over it."""
    hollow = "" if bar.row.confirmed or bar.row.suspect else " hollow"
    yield f'<rect class="{bar.colour}{hollow}" {place}/>'
    if bar.row.suspect:
        yield f'<rect fill="url(#stripes)" {place}/>'


def _whisker(row: Speedup) -> str:
    return "whisker" if row.low is not None else "whisker of-session"


def _label(bar: _Bar, words: str) -> str:
    value = formats.speedup(bar.row.speedup, bar.row.range)
    return f'{words} <tspan class="value">{value}</tspan><tspan class="whose"> {escape(bar.short)}</tspan>'
