"""What each parameter does to the objectives: slices, and all of them as parallel coordinates."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pareto.plot.arrivals import Arrivals
from pareto.plot.style import FRONT, LINE, axis, blank, label, text
from pareto.spaces.parameter import Parameter

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

MOST_POINTS = 1000  # beyond that a page with many parameters becomes slow
MOST_TICKS = 8  # of listed values on an axis
TICKS = 5  # where any value may be taken
COLUMNS = 4
HEIGHT = 210  # of a row of slices
INACTIVE = "inactive"


def slices(arrivals: Arrivals, objective: int, units: Mapping[str, str] | None = None) -> Figure:
    """Return an objective's values over each parameter's, early measurements light and late ones dark.

    A parameter is left out where it is inactive, and where it never differs.
    """
    from plotly.subplots import make_subplots

    space, rows = arrivals.explorer.space, _shown(arrivals)
    parameters = [item for item in space.parameters if len(item.values) > 1]
    columns = min(COLUMNS, max(len(parameters), 1))
    lines = max(1, math.ceil(len(parameters) / columns))
    style = blank(80 + HEIGHT * lines)
    figure = make_subplots(
        lines, columns, shared_yaxes=True, horizontal_spacing=0.02, vertical_spacing=0.3 / lines
    )
    figure.update_layout(style.layout, showlegend=False)
    points = [space.decode(int(index)) for index in arrivals.indices[rows]]
    scale = axis(label(arrivals.names[objective], units or {}), arrivals.values[rows, objective])
    for number, parameter in enumerate(parameters):
        kept = [place for place, point in enumerate(points) if point[parameter.name] is not None]
        values = [points[place][parameter.name] for place in kept]
        line, column = number // columns + 1, number % columns + 1
        figure.add_scatter(
            x=values if _numeric(parameter) else [text(value) for value in values],
            y=arrivals.values[rows[kept], objective],
            mode="markers",
            marker={"color": rows[kept], "colorscale": [[0, "#c6dbef"], [1, "#08306b"]], "size": 5},
            hovertemplate=f"{text(parameter.name)} %{{x}}<br>%{{y:.4g}}<extra></extra>",
            row=line,
            col=column,
        )
        horizontal: dict[str, Any] = {"title": {"text": text(parameter.name)}, "type": "linear"}
        if not _numeric(parameter):
            order = [text(value) for value in parameter.values]
            horizontal |= {"type": "category", "categoryorder": "array", "categoryarray": order}
        elif parameter.values[0] > 0 and parameter.values[-1] > 20 * parameter.values[0]:  # type: ignore[operator]
            horizontal |= {"type": "log", "dtick": 1, "exponentformat": "power"}
        figure.update_xaxes(horizontal, row=line, col=column)
        vertical = scale if column == 1 else {**scale, "title": None}
        figure.update_yaxes(vertical, row=line, col=column)
    return figure


def parallel_coordinates(arrivals: Arrivals, units: Mapping[str, str] | None = None) -> Figure:
    """Return a line for each measurement through all parameters and objectives; the front is blue."""
    space, rows = arrivals.explorer.space, _shown(arrivals)
    front = np.isin(arrivals.indices[rows], arrivals.explorer.history.front()[0])
    rows, front = np.concatenate([rows[~front], rows[front]]), np.sort(front)  # the front is drawn last
    figure = blank(460)
    points = [space.decode(int(index)) for index in arrivals.indices[rows]]
    dimensions = [
        _dimension(parameter, [point[parameter.name] for point in points])
        for parameter in space.parameters
        if len(parameter.values) > 1
    ]
    dimensions += [
        _objective(label(name, units or {}), arrivals.values[rows, column])
        for column, name in enumerate(arrivals.names)
    ]
    figure.add_parcoords(
        dimensions=dimensions,
        line={"color": front.astype(int), "cmin": 0, "cmax": 1, "colorscale": [[0, LINE], [1, FRONT]]},
        labelangle=-20,
        labelside="bottom",
    )
    return figure.update_layout(margin={"l": 60, "r": 60, "t": 24, "b": 90})


def _shown(arrivals: Arrivals) -> NDArray[np.int64]:
    """Return the rows to draw: of very many a regular selection, the front always."""
    succeeded = np.flatnonzero(arrivals.succeeded)
    front = np.flatnonzero(np.isin(arrivals.indices, arrivals.explorer.history.front()[0]))
    return np.union1d(succeeded[:: max(1, math.ceil(len(succeeded) / MOST_POINTS))], front)


def _numeric(parameter: Parameter) -> bool:
    return parameter.ordered and not any(isinstance(value, (bool, str)) for value in parameter.values[:1])


def _dimension(parameter: Parameter, values: list[Any]) -> dict[str, Any]:
    """Return an axis with the positions of the values; a value of None lies below all."""
    size = len(parameter.values)
    places = [-size / 10 if value is None else parameter.encode(value) for value in values]
    ticks = np.unique(
        np.linspace(0, size - 1, TICKS if parameter.levels else min(size, MOST_TICKS)).round().astype(int)
    ).tolist()
    texts = [text(_short(parameter.values[tick])) for tick in ticks]
    if None in values:
        ticks, texts = [-size / 10, *ticks], [INACTIVE, *texts]
    return {
        "label": text(parameter.name),
        "values": places,
        "range": [min(ticks), size - 1],
        "tickvals": ticks,
        "ticktext": texts,
    }


def _objective(name: str, values: NDArray[np.float64]) -> dict[str, Any]:
    """Return an axis with the values, or their logarithms where `axis` would take them."""
    look = axis(name, values)
    if look["type"] == "linear":
        return {"label": look["title"]["text"], "values": values}
    logs = np.log10(values)
    ticks = np.linspace(logs.min(), logs.max(), TICKS)
    return {
        "label": look["title"]["text"],
        "values": logs,
        "tickvals": ticks,
        "ticktext": [f"{10**tick:.3g}" for tick in ticks],
    }


def _short(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
