"""Common parts of heat maps."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from plotly import graph_objects as go
from plotly.colors import sequential

from crowd.dashboard.figures.elements import layout
from crowd.dashboard.figures.palette import Theme

# Suitable for colour-blind readers and in greyscale. On a dark page, dark colours would sink into the ground.
COLOURS = {"light": sequential.Cividis, "dark": sequential.Viridis[4:]}
ROW = 26  # pixels


def add_cells(
    figure: go.Figure,
    values: NDArray[np.float64],
    hover: Sequence[Sequence[str]],
    theme: Theme,
    **changes: Any,
) -> None:
    """Draw `values` (rows, columns) at integer positions, the first row on top; NaN stays blank.

    `hover` has the label of each cell.
    """
    figure.add_heatmap(
        z=[layout.rounded(row) for row in values],
        customdata=hover,
        hovertemplate="%{customdata}<extra></extra>",
        hoverongaps=False,
        xgap=1,
        ygap=1,
        **{
            "colorscale": COLOURS[theme.name],
            "colorbar": bar(theme, ""),
            **changes,
        },
    )
    figure.update_layout(
        xaxis={"showgrid": False, "zeroline": False, "range": [-0.5, values.shape[1] - 0.5]},
        yaxis={"showgrid": False, "zeroline": False, "range": [values.shape[0] - 0.5, -0.5]},
    )


def bar(theme: Theme, title: str, **changes: Any) -> dict[str, Any]:
    """The colour bar: horizontal and above the cells, so that it fits on a phone."""
    return {
        "orientation": "h",
        "thickness": 10,
        "x": 0,
        "xanchor": "left",
        "len": 0.7,
        "y": 1.01,
        "yanchor": "bottom",
        "outlinewidth": 0,
        "tickfont": {"color": theme.muted, "size": 12},
        "tickangle": 0,
        "title": {"text": title, "side": "top", "font": {"color": theme.muted, "size": 13}},
        **changes,
    }


def named_axis(names: Sequence[str], title: str = "") -> dict[str, Any]:
    """An axis with a name at each integer."""
    return {
        # Larger than usual, because plotly underestimates the size of named ticks.
        "title": {"text": title} | ({"standoff": 34} if title else {}),
        "tickmode": "array",
        "tickvals": list(range(len(names))),
        "ticktext": [layout.text(name) for name in names],
    }
