"""Common parts of all charts: axes, fonts, colours, and escaped text."""

import html
import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from plotly import graph_objects as go

from crowd.dashboard import formats
from crowd.dashboard.figures.palette import Theme
from crowd.records.speedup import Speedup
from crowd.results.reading.rows import Release
from wire.front import BEST, DEFAULT

FONT = "system-ui, 'Segoe UI', Roboto, 'Helvetica Neue', 'Noto Sans', 'Liberation Sans', sans-serif"

# What captions call a dotted line: plotly's own "dot" looks like short dashes.
DOTTED = "1.5px,3px"
# Thickness of a flat bar, in rows.
BAR = 0.4
# The name of annotations that label horizontal bars.
ROW_NAME = "row"
LONGEST_NAME = 72  # letters, of the name of a flat bar
LONGEST_NAME_ON_PHONES = 30


def blank(theme: Theme, height: int) -> go.Figure:
    """A figure without traces in `theme`, `height` pixels high, as wide as the page allows."""
    axis = {
        "gridcolor": theme.line,
        "linecolor": theme.line,
        "zerolinecolor": theme.line,
        "tickfont": {"color": theme.muted},
        "title": {"font": {"color": theme.muted, "size": 13}, "standoff": 10},
        "automargin": True,
        "fixedrange": True,
    }
    return go.Figure(
        layout={
            # Replaces plotly's default template, which adds 6 kB and has other colours.
            "template": {"layout": {"xaxis": axis, "yaxis": axis | {"ticklabelstandoff": 4}}},
            "height": height,
            "paper_bgcolor": "rgba(0,0,0,0)",
            "plot_bgcolor": "rgba(0,0,0,0)",
            "font": {"family": FONT, "size": 13, "color": theme.ink},
            "margin": {"l": 8, "r": 12, "t": 32, "b": 8},
            "hoverlabel": {
                "bgcolor": theme.surface,
                "bordercolor": theme.muted,
                "font": {"color": theme.ink, "family": FONT, "size": 13},
                "align": "left",
            },
            "legend": {
                "orientation": "h",
                "x": 0,
                "y": 1.0,
                "yanchor": "bottom",
                "font": {"color": theme.ink},
            },
            "dragmode": False,
        }
    )


def state_words(row: Speedup) -> list[str]:
    """The state of a figure that is not counted, for a hover label."""
    if row.suspect:
        return ["suspect: no session of it is valid"]
    return [] if row.confirmed else ["unconfirmed"]


def interval_words(row: Speedup) -> list[str]:
    """The interval of `row` for a hover label; empty without one."""
    if row.low is not None:
        return [f"95 % interval {formats.interval(row.low, row.high)}"]
    if row.session_low is not None:
        return [f"95 % interval of one session {formats.interval(row.session_low, row.session_high)}"]
    return []


def count_words(row: Speedup | Release) -> str:
    """The sessions and installations behind `row`."""
    return f"{formats.plural(row.sessions, 'session')}, {formats.plural(row.installations, 'installation')}"


def name_bars(figure: go.Figure, bars: Iterable[tuple[str, str]], theme: Theme) -> None:
    """Write the value and name of horizontal `bars` above each of them, which fits on a phone.

    All are added at once, because plotly checks all annotations with each addition.
    """
    bars = list(bars)
    others = [words.to_plotly_json() for words in figure.layout.annotations]

    def named(longest: int) -> list[dict[str, Any]]:
        return [
            *others,
            *(
                _row_name(rank, value, clipped(name, longest), theme)
                for rank, (value, name) in enumerate(bars)
            ),
        ]

    figure.update_layout(annotations=named(LONGEST_NAME))
    if any(len(name) > LONGEST_NAME_ON_PHONES for _, name in bars):
        figure.update_layout(meta={"narrow": {"annotations": named(LONGEST_NAME_ON_PHONES)}})


def _row_name(rank: int, value: str, name: str, theme: Theme) -> dict[str, Any]:
    return {
        "name": ROW_NAME,
        "x": 0,
        # The axis points down: this is the bar's upper edge.
        "y": rank - BAR / 2,
        "text": f"<b>{value}</b>  {text(name)}",
        "font": {"color": theme.ink, "size": 13},
        "xanchor": "left",
        "yanchor": "bottom",
        "xshift": -4,
        "yshift": 1,
        "showarrow": False,
        "bgcolor": theme.surface,
        "borderpad": 2,
    }


def flat_rows(rows: int) -> dict[str, Any]:
    """The y axis of horizontal bars, the first on top, with room for a name above each."""
    return {"range": [max(rows, 1) - 0.6, -0.72], "visible": False}


def span(values: Sequence[float], least: float) -> list[float]:
    """The range of an axis for `values`: at least `least` wide, and not below 0 for non-negative values."""
    low, high = min(values), max(values)
    room = max((least - (high - low)) / 2, (high - low) * 0.05)
    if low >= 0 and low < room:
        return [0.0, max(high + room, least)]
    return [low - room, high + room]


def log_ticks(low: float, high: float) -> list[float]:
    """Round numbers from `low` to `high` (both above 0) for a logarithmic scale; denser in a short range."""
    if high > 10 * low:
        digits = [1.0, 2.0, 5.0]
    elif high > 3 * low:
        digits = [1.0, 1.5, 2.0, 3.0, 5.0, 7.0]
    else:
        digits = [half / 2 for half in range(2, 20)]
    powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    ticks = [digit * 10.0**power for power in powers for digit in digits]
    return [tick for tick in ticks if low <= tick <= high]


def log_axis(title: str, values: Iterable[float] = ()) -> dict[str, Any]:
    """A logarithmic axis for `values` with complete tick labels; plotly would write 2 for 20."""
    positive = [value for value in values if value > 0] or [1e-3, 1e6]
    # A little beyond the values, because plotly adds a margin.
    ticks = log_ticks(min(positive) / 1.1, max(positive) * 1.1)
    return {
        "title": {"text": title},
        "type": "log",
        "tickmode": "array",
        "tickvals": ticks,
        "ticktext": [f"{tick:,g}" for tick in ticks],
        "zeroline": False,
    }


def configuration_colours(names: Iterable[str], theme: Theme) -> dict[str, str]:
    """A colour per configuration: fixed ones for default and best, others in order of appearance."""
    fixed = {DEFAULT: theme.default, BEST: theme.best}
    others = [name for name in dict.fromkeys(names) if name not in fixed]
    # Lines in the first colour, a blue, would look like those of default.
    colours = theme.series[1:]
    return fixed | {name: colours[number % len(colours)] for number, name in enumerate(others)}


def shade_uncounted(figure: go.Figure, first_counted: int, theme: Theme) -> None:
    """Shade the frames before `first_counted`, which statistics do not use."""
    figure.add_shape(
        type="rect",
        x0=-0.5,
        x1=first_counted - 0.5,
        yref="paper",
        y0=0,
        y1=1,
        fillcolor=theme.line,
        opacity=0.55,
        layer="below",
        line={"width": 0},
    )


def limit_line(figure: go.Figure, centimetres: float, theme: Theme, anchor: str) -> None:
    """Add the vertical line between valid and invalid trajectories to a logarithmic axis."""
    upright_line(figure, centimetres, f"valid below {centimetres:g} cm", theme.limit, log=True, anchor=anchor)


def upright_line(
    figure: go.Figure, x: float, words: str, colour: str, log: bool = False, anchor: str = "center"
) -> None:
    """Add a dashed vertical line at X with `words` above it. `log`: the x axis is logarithmic.

    `anchor` is the horizontal anchor of `words`.
    """
    figure.add_shape(
        type="line",
        x0=x,
        x1=x,
        yref="paper",
        y0=0,
        y1=1,
        line={"color": colour, "width": 1.5, "dash": "dash"},
    )
    figure.add_annotation(
        # On a logarithmic axis plotly places shapes by value and annotations by exponent.
        x=float(np.log10(x)) if log else x,
        xanchor=anchor,
        yref="paper",
        y=1,
        yanchor="bottom",
        text=words,
        font={"color": colour, "size": 13},
        showarrow=False,
    )


def note(figure: go.Figure, words: str, theme: Theme) -> go.Figure:
    """Write `words` into the middle of an empty `figure`."""
    return figure.add_annotation(
        xref="paper", yref="paper", x=0.5, y=0.5, text=words, font={"color": theme.muted}, showarrow=False
    )


def corner(figure: go.Figure, words: str, theme: Theme) -> go.Figure:
    """Write `words` about the drawing into the lower right corner of `figure`."""
    return figure.add_annotation(
        xref="paper",
        yref="paper",
        x=1,
        y=0,
        xanchor="right",
        yanchor="bottom",
        text=words,
        font={"color": theme.muted, "size": 12},
        bgcolor=theme.surface,
        showarrow=False,
    )


def text(raw: str) -> str:
    """`raw` escaped for plotly, which interprets some HTML in every text."""
    return html.escape(raw, quote=False)


def lines(parts: Sequence[str]) -> str:
    """`parts` on a line each, for a hover label."""
    return "<br>".join(parts)


def clipped(name: str, length: int) -> str:
    """`name` cut to `length` characters with an ellipsis."""
    return name if len(name) <= length else name[: length - 1].rstrip() + "\N{HORIZONTAL ELLIPSIS}"


def rounded(values: ArrayLike) -> list[float | None]:
    """`values` with four significant digits, which saves three quarters of the bytes. NaN becomes None."""
    return [
        float(f"{value:.4g}") if np.isfinite(value) else None
        for value in np.asarray(values, dtype=np.float64)
    ]
