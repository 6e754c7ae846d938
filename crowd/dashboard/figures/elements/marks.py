"""Marks of figures that are not counted, the same in all charts: unconfirmed is hollow, suspect is striped.

Tables use a ring and an exclamation mark.
"""

from collections.abc import Sequence
from typing import Any

from plotly import graph_objects as go

from crowd.dashboard.figures.palette import Theme, mixed
from crowd.records.speedup import Speedup

STRIPES = "/"
UNCONFIRMED, SUSPECT = "unconfirmed", "suspect"
# Opacity of the inside of a hollow bar: slightly coloured, to distinguish bars from gaps.
INSIDE = 0.15


def bar_marks(
    rows: Sequence[Speedup], colours: Sequence[str], theme: Theme, edge: float = 1.5
) -> dict[str, Any]:
    """The markers of bars for `rows` in `colours`. `edge`: line width of hollow bars in pixels."""
    states = [_state(row) for row in rows]
    alike = len(set(colours)) == 1 and UNCONFIRMED not in states
    marks: dict[str, Any] = {
        "color": colours[0]
        if alike
        else [
            mixed(colour, theme.surface, INSIDE) if state == UNCONFIRMED else colour
            for colour, state in zip(colours, states, strict=True)
        ],
        "line": _edges(states, colours, edge),
    }
    if SUSPECT in states:
        marks["pattern"] = {
            "shape": [STRIPES if state == SUSPECT else "" for state in states],
            "fillmode": "overlay",
            "fgcolor": theme.surface,
            "fgopacity": 0.75,
            "size": 7,
            "solidity": 0.35,
        }
    return marks


def _state(row: Speedup) -> str:
    if row.suspect:
        return SUSPECT
    return "" if row.confirmed else UNCONFIRMED


def _edges(states: Sequence[str], colours: Sequence[str], edge: float) -> dict[str, Any]:
    if UNCONFIRMED not in states:
        return {"width": 0}
    return {"color": list(colours), "width": [edge if state == UNCONFIRMED else 0 for state in states]}


def add_legend(figure: go.Figure, rows: Sequence[Speedup], theme: Theme) -> None:
    """Explain hollow and striped bars in the legend, if `rows` have some."""
    states = {_state(row) for row in rows} - {""}
    for state, symbol in ((UNCONFIRMED, "square"), (SUSPECT, "square-x")):
        if state in states:
            figure.add_scatter(
                x=[None],
                y=[None],
                mode="markers",
                name=state,
                # First, because plotly cuts long words in the last column.
                legendrank=1,
                marker={
                    "symbol": symbol,
                    "size": 12,
                    "color": mixed(theme.muted, theme.surface, INSIDE),
                    "line": {"color": theme.muted, "width": 1.5},
                },
                hoverinfo="skip",
                showlegend=True,
            )
    if states:
        figure.update_layout(showlegend=True)
