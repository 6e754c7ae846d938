"""Shared by all pictures: colours, fonts, axes, and escaped text."""

from __future__ import annotations

import html
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

# The paper's colours: random samples red, active learning black. The others are of Okabe and Ito's palette,
# which the colour-blind can tell apart.
PHASES = {
    "random": ("random samples", "#d62728"),
    "active": ("active learning", "#222222"),
    "told": ("measured before", "#8c8c8c"),
}
FRONT = "#0072b2"
DEFAULT = "#e69f00"
LIMIT = "#9a9a9a"
SERIES = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")  # one an objective

INK, MUTED, LINE = "#222222", "#5f6368", "#e4e4e4"
FONT = "system-ui, 'Segoe UI', Roboto, 'Helvetica Neue', 'Noto Sans', 'Liberation Sans', sans-serif"


def blank(height: int) -> Figure:
    """Return a figure without traces, `height` pixels high and as wide as its place."""
    import plotly.graph_objects as go

    axis = {
        "gridcolor": LINE,
        "linecolor": "#bdbdbd",
        "showline": True,
        "ticks": "outside",
        "tickcolor": "#bdbdbd",
        "zeroline": False,
        "tickfont": {"color": MUTED},
        "title": {"font": {"size": 13, "color": INK}, "standoff": 8},
        "automargin": True,
    }
    return go.Figure(
        layout={
            "template": {"layout": {"xaxis": axis, "yaxis": axis}},
            "height": height,
            "font": {"family": FONT, "size": 13, "color": INK},
            "paper_bgcolor": "white",
            "plot_bgcolor": "white",
            "margin": {"l": 8, "r": 16, "t": 40, "b": 8},
            "legend": {"orientation": "h", "x": 0, "y": 1.0, "yanchor": "bottom", "itemsizing": "constant"},
            "hoverlabel": {
                "bgcolor": "white",
                "bordercolor": "#bdbdbd",
                "align": "left",
                "font": {"size": 12},
            },
            "hovermode": "closest",
        }
    )


def axis(title: str, values: Iterable[float]) -> dict[str, Any]:
    """Return an axis for `values`: logarithmic where they are positive and spread over a factor 5."""
    numbers = list(values)
    low, high = (min(numbers), max(numbers)) if numbers else (0.0, 0.0)
    log = low > 0 and high > 5 * low
    # "SI" writes 0.02 as 20m, which reads as metres.
    return {
        "title": {"text": text(title) + (" (log)" if log else "")},
        "type": "log" if log else "linear",
        "exponentformat": "power",
        **({"dtick": "D2" if high < 300 * low else 1} if log else {}),
    }


def stairs(maximised: bool) -> str:
    """Return the line shape that bounds what a front dominates, `maximised` telling of the x axis."""
    return "vh" if maximised else "hv"


def label(name: str, units: Mapping[str, str]) -> str:
    """Return an objective's name with its unit, where that is known."""
    return f"{name} [{units[name]}]" if units.get(name) else name


def text(raw: object) -> str:
    """Return `raw` as Plotly and browsers show it literally: both read HTML in every text."""
    return html.escape(str(raw), quote=False)


def number(value: float) -> str:
    """Return a value with four significant digits."""
    return f"{value:.4g}"
