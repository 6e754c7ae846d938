"""The exploration in the plane of two objectives, as in the paper: random samples red, active ones black."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pareto.plot.arrivals import Arrivals
from pareto.plot.style import (
    DEFAULT,
    FRONT,
    LIMIT,
    MUTED,
    PHASES,
    SERIES,
    axis,
    blank,
    label,
    number,
    stairs,
    text,
)
from pareto.search.recommendation import Estimates
from pareto.spaces.grid import Indices
from pareto.spaces.parameter import Parameter

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

MOST_POINTS = 10_000  # beyond that a browser becomes slow


def scatter(
    arrivals: Arrivals,
    first: int = 0,
    second: int = 1,
    units: Mapping[str, str] | None = None,
    by: Parameter | None = None,
) -> Figure:
    """Return every measured configuration in the plane of two objectives, with the limits and the front.

    The front drawn is that of the two objectives shown, among the points within all limits: of the expected
    values, with their intervals, where repeats differ. Hovering shows the configuration. Of very many points
    a regular selection is drawn, the front always. Colours are those of the phases, or of the values of the
    parameter `by`, on the front, too.
    """
    units = units or {}
    x_name, y_name = arrivals.names[first], arrivals.names[second]
    succeeded = np.flatnonzero(arrivals.succeeded)
    shown = succeeded[:: max(1, math.ceil(len(succeeded) / MOST_POINTS))]
    figure = blank(560)
    hover = f"%{{text}}<br><b>{text(x_name)} %{{x:.4g}}<br>{text(y_name)} %{{y:.4g}}</b><extra></extra>"

    def add(indices: Indices, values: NDArray[np.float64], name: str, **looks: object) -> None:
        figure.add_scatter(
            x=values[:, first],
            y=values[:, second],
            name=f"{name} ({len(indices)})",
            text=[arrivals.describe(int(index)) for index in indices],
            hovertemplate=hover,
            **looks,
        )

    def add_measured(rows: NDArray[np.int64], name: str, **looks: object) -> None:
        add(arrivals.indices[rows], arrivals.values[rows], name, **looks)

    groups = arrivals.phases if by is None else arrivals.values_of(by, arrivals.indices)
    looks_of = PHASES if by is None else _looks(by)
    for group in dict.fromkeys([*looks_of, *groups.tolist()]):
        rows = shown[groups[shown] == group]
        if len(rows):
            name, colour = looks_of.get(group, (group, "#8c8c8c"))
            add_measured(rows, name, mode="markers", marker={"color": colour, "size": 5, "opacity": 0.55})
    estimates, front = arrivals.estimates, arrivals.recommended(first, second)
    if len(front):
        colours = FRONT if by is None else _colours(by, arrivals.values_of(by, estimates.indices[front]))
        looks: dict[str, object] = {
            "line": {"color": FRONT, "width": 2, "shape": stairs(arrivals.maximise[first])},
            "marker": {"color": colours, "size": 7 if by is None else 10},
        }
        if estimates.noisy:
            looks |= {
                f"error_{letter}": _bars(estimates, front, column)
                for letter, column in (("x", first), ("y", second))
            }
        name = "recommended" if estimates.noisy else "front"
        add(estimates.indices[front], estimates.expected[front], name, mode="lines+markers", **looks)
    space = arrivals.explorer.space
    default = succeeded[arrivals.indices[succeeded] == space.index_of(space.default)]
    if len(default):
        marker = {"color": DEFAULT, "size": 13, "symbol": "diamond", "line": {"color": "white", "width": 1}}
        add_measured(default, "default", mode="markers", marker=marker)
    figure.update_layout(
        xaxis=axis(label(x_name, units), arrivals.values[succeeded, first]),
        yaxis=axis(label(y_name, units), arrivals.values[succeeded, second]),
    )
    _add_limits(figure, arrivals, first, second)
    return figure


def _looks(by: Parameter) -> dict[str, tuple[str, str]]:
    """Name and colour of each value."""
    return {
        str(value): (f"{by.name} {value}", SERIES[number % len(SERIES)])
        for number, value in enumerate(by.values)
    }


def _colours(by: Parameter, values: NDArray[np.str_]) -> list[str]:
    looks = _looks(by)
    return [looks[value][1] for value in values.tolist()]


def _bars(estimates: Estimates, rows: NDArray[np.int64], column: int) -> dict[str, object]:
    """Return the intervals of an objective as Plotly's error bars."""
    expected = estimates.expected[rows, column]
    return {
        "type": "data",
        "array": estimates.high[rows, column] - expected,
        "arrayminus": expected - estimates.low[rows, column],
        "color": FRONT,
        "thickness": 1,
        "width": 0,
    }


def _add_limits(figure: Figure, arrivals: Arrivals, first: int, second: int) -> None:
    for which, letter, other in ((first, "x", "y"), (second, "y", "x")):
        limit = arrivals.limits[which]
        if limit is None:
            continue
        log = figure.layout[f"{letter}axis"].type == "log"
        if log and limit <= 0:
            continue
        line = {f"{letter}0": limit, f"{letter}1": limit, f"{other}0": 0, f"{other}1": 1}
        figure.add_shape(
            type="line",
            **line,
            **{f"{other}ref": "paper"},
            line={"dash": "dash", "color": LIMIT, "width": 1.5},
        )
        bound = "at least" if arrivals.maximise[which] else "at most"
        figure.add_annotation(
            # On a logarithmic axis Plotly places shapes by value and annotations by exponent.
            **{letter: math.log10(limit) if log else limit, other: 1, f"{other}ref": "paper"},
            text=f"{text(arrivals.names[which])} {bound} {number(limit)}",
            font={"color": MUTED, "size": 12},
            bgcolor="rgba(255,255,255,0.8)",
            xanchor="left" if letter == "x" else "right",
            yanchor="top" if letter == "x" else "bottom",
            showarrow=False,
        )
