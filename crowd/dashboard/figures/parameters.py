"""A front's configurations by their parameters: one line a configuration, one axis a parameter.

Plotly has a trace for parallel axes, which builds code in the browser; these are plain lines.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from plotly import graph_objects as go
from plotly.colors import sample_colorscale

from crowd.dashboard import formats
from crowd.dashboard.figures import heat, layout
from crowd.dashboard.palette import Theme
from crowd.fronts.selectors import BEST, DEFAULT, Point

ROW = 62  # pixels of an axis
# Lines through the same values lie side by side, over this share of an axis.
SPREAD = 0.05


def parameters_height(parameters: int) -> int:
    """Pixels that parameter_lines needs."""
    return 120 + ROW * max(parameters, 1)


def parameter_lines(points: Sequence[Point], theme: Theme) -> go.Figure:
    """Each of POINTS as a line from parameter to parameter, coloured by its runtime (logarithmic).

    An axis lies flat and holds the values that occur, in order and at equal distances. Default and best are
    thicker, in their own colours; a point without a runtime is grey.
    """
    names = list(dict.fromkeys(name for point in points for name in point.parameters))
    axes = {name: _occurring(points, name) for name in names}
    figure = layout.blank(theme, parameters_height(len(names)))
    runtimes = [np.log10(point.runtime * 1e3) for point in points if point.runtime]
    low, high = (min(runtimes), max(runtimes)) if runtimes else (0.0, 1.0)
    fixed = {DEFAULT: theme.default, BEST: theme.best}
    # The two that everybody looks for lie on top.
    for number, point in sorted(enumerate(points), key=lambda item: item[1].name in fixed):
        shift = (number / max(len(points) - 1, 1) - 0.5) * SPREAD
        rows = [rank for rank, name in enumerate(names) if name in point.parameters]
        figure.add_scatter(
            x=[round(_place(axes[names[rank]], point.parameters[names[rank]]) + shift, 4) for rank in rows],
            y=rows,
            mode="lines+markers",
            name=layout.text(point.name),
            line={
                "color": fixed.get(point.name) or _colour(point, low, high, theme),
                "width": 3.5 if point.name in fixed else 1.5,
            },
            marker={"size": 8 if point.name in fixed else 5},
            customdata=[
                f"{layout.text(formats.words(names[rank]))} "
                f"{layout.text(formats.parameter(point.parameters[names[rank]]))}"
                for rank in rows
            ],
            hovertemplate=f"<b>{_literal(point.name)}</b>, {formats.milliseconds(point.runtime)} a frame<br>"
            "%{customdata}<extra></extra>",
            showlegend=point.name in fixed,
        )
    _add_axes(figure, axes, theme)
    if runtimes and high > low:
        _add_scale(figure, low, high, theme)
    return figure.update_layout(
        xaxis={"visible": False, "range": [-0.08, 1.08]},
        yaxis={"visible": False, "range": [max(len(names), 1) - 0.4, -0.6]},
        margin={"t": 76},
        hovermode="closest",
        legend={"y": 1.0, "x": 1, "xanchor": "right"},
    )


def _occurring(points: Sequence[Point], name: str) -> list[Any]:
    """The values of parameter NAME that occur, ascending; what is no number comes after, by its text."""
    values = {point.parameters[name] for point in points if name in point.parameters}
    return sorted(
        values, key=lambda value: (isinstance(value, str), value if _number(value) else 0, str(value))
    )


def _number(value: object) -> bool:
    return isinstance(value, int | float)


def _short(value: object) -> str:
    """VALUE with three digits: more have no room beside each other, and stand in the table."""
    return f"{value:.3g}" if isinstance(value, float) else formats.parameter(value)


def _place(values: Sequence[Any], value: Any) -> float:
    """Where VALUE stands on an axis from 0 to 1; in its middle where it is the only one."""
    return values.index(value) / (len(values) - 1) if len(values) > 1 else 0.5


def _colour(point: Point, low: float, high: float, theme: Theme) -> str:
    if not point.runtime:
        return theme.muted
    share = (np.log10(point.runtime * 1e3) - low) / (high - low) if high > low else 0.0
    return str(sample_colorscale(heat.COLOURS, [float(share)])[0])


def _add_axes(figure: go.Figure, axes: Mapping[str, Sequence[Any]], theme: Theme) -> None:
    """All of AXES at once: plotly checks all that is there already with each label that is added."""
    lines: list[dict[str, Any]] = []
    labels: list[dict[str, Any]] = []
    for rank, (name, values) in enumerate(axes.items()):
        lines.append(
            {"type": "line", "x0": 0, "x1": 1, "y0": rank, "y1": rank, "layer": "below",
             "line": {"color": theme.line}}
        )  # fmt: skip
        labels.append(
            {"x": 0, "y": rank, "xshift": -8, "yshift": 13, "text": layout.text(formats.words(name)),
             "xanchor": "left", "yanchor": "bottom", "font": {"color": theme.ink, "size": 13},
             "bgcolor": theme.surface, "borderpad": 1, "showarrow": False}
        )  # fmt: skip
        labels += [
            {"x": _place(values, value), "y": rank, "yshift": -7, "text": layout.text(_short(value)),
             "yanchor": "top", "font": {"color": theme.muted, "size": 12}, "bgcolor": theme.surface,
             "borderpad": 0, "showarrow": False}
            for value in values
        ]  # fmt: skip
    figure.update_layout(shapes=lines, annotations=labels)


def _add_scale(figure: go.Figure, low: float, high: float, theme: Theme) -> None:
    """The scale of colours, which belongs to a trace that draws nothing."""
    ticks = layout.log_ticks(10.0**low, 10.0**high)
    figure.add_scatter(
        x=[None],
        y=[None],
        mode="markers",
        marker={
            "color": [low],
            "cmin": low,
            "cmax": high,
            "colorscale": heat.COLOURS,
            "showscale": True,
            "colorbar": heat.bar(
                theme,
                "runtime, ms a frame (log)",
                tickvals=[float(np.log10(tick)) for tick in ticks],
                ticktext=[f"{tick:g}" for tick in ticks],
                len=0.5,
            ),
        },
        hoverinfo="skip",
        showlegend=False,
    )


def _literal(name: str) -> str:
    # Braces would be read as a field of the hover template.
    return layout.text(name).replace("{", "(").replace("}", ")")
