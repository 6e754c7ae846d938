"""Pictures of an exploration, as self-contained HTML."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pareto.explorer import Explorer
from pareto.front import nondominated

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

# The paper's colours: random samples red, active learning black.
COLOURS = {"random": "#d62728", "active": "#222222", "repeat": "#7f7f7f", "told": "#1f77b4"}
MOST_POINTS = 10_000  # beyond that a browser becomes slow


def scatter(explorer: Explorer, first: int = 0, second: int = 1) -> Figure:
    """Return every measured configuration in the plane of two objectives, with the limits and the front.

    The front drawn is that of the two objectives shown, among the points within all limits. Hovering tells
    the configuration. Of very many points a regular selection is drawn, the front always.
    """
    import plotly.graph_objects as go

    history = explorer.history
    indices, values = history.measured()
    x_name, y_name = (explorer.objectives[axis].name for axis in (first, second))
    phases = np.array([history.phases[int(index)] for index in indices], dtype=object)
    shown = np.zeros(len(indices), dtype=bool)
    shown[:: max(1, len(indices) // MOST_POINTS)] = True
    figure = go.Figure()
    for phase, colour in COLOURS.items():
        rows = np.flatnonzero((phases == phase) & shown)
        if len(rows):
            figure.add_scatter(
                x=values[rows, first],
                y=values[rows, second],
                mode="markers",
                name=phase,
                marker={"color": colour, "size": 5, "opacity": 0.6},
                text=[_describe(explorer, int(index)) for index in indices[rows]],
                hovertemplate=f"%{{text}}<br>{x_name} %{{x}}<br>{y_name} %{{y}}<extra></extra>",
            )
    front = _front(explorer, values, first, second)
    figure.add_scatter(
        x=values[front, first],
        y=values[front, second],
        mode="lines+markers",
        name="front",
        line={"color": "#2ca02c", "width": 2, "shape": "hv"},
        text=[_describe(explorer, int(index)) for index in indices[front]],
        hovertemplate=f"%{{text}}<br>{x_name} %{{x}}<br>{y_name} %{{y}}<extra></extra>",
    )
    if x_name in explorer.limits:
        figure.add_vline(x=explorer.limits[x_name], line_dash="dot", line_color="#888888")
    if y_name in explorer.limits:
        figure.add_hline(y=explorer.limits[y_name], line_dash="dot", line_color="#888888")
    scales = ["log" if len(values) and values[:, axis].min() > 0 else "linear" for axis in (first, second)]
    failed = len(history.failed())
    figure.update_layout(
        template="plotly_white",
        title=f"{explorer.space.name}: {len(indices)} measured, {failed} failed, {len(front)} on the front",
        xaxis={"title": x_name, "type": scales[0]},
        yaxis={"title": y_name, "type": scales[1]},
    )
    return figure


def save(explorer: Explorer, path: str | Path) -> None:
    """Write one scatter for each pair of objectives to a single file that needs no network.

    An exploration of one objective is drawn against itself.
    """
    count = len(explorer.objectives)
    pairs = [(first, second) for first in range(count) for second in range(first + 1, count)] or [(0, 0)]
    parts = [
        scatter(explorer, first, second).to_html(full_html=False, include_plotlyjs=number == 0)
        for number, (first, second) in enumerate(pairs)
    ]
    title = f"<title>{_escape(explorer.space.name)}</title>"
    head = f'<!doctype html>\n<html lang="en">\n<head><meta charset="utf-8">{title}</head>\n<body>\n'
    Path(path).write_text(head + "\n".join(parts) + "\n</body>\n</html>\n", encoding="utf-8")


def _front(explorer: Explorer, values: NDArray[np.float64], first: int, second: int) -> NDArray[np.int64]:
    rows = np.flatnonzero(explorer.history.within_limits(values))
    plane = values[rows][:, [first, second]]
    rows = rows[nondominated(plane, [explorer.objectives[axis].maximise for axis in (first, second)])]
    return rows[np.argsort(values[rows, first], kind="stable")]


def _describe(explorer: Explorer, index: int) -> str:
    return "<br>".join(f"{_escape(name)} {value}" for name, value in explorer.space.decode(index).items())


def _escape(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
