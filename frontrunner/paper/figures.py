"""The figures that only the paper has: measured and predicted fronts, and the bars of the crowd."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from frontrunner.paper.crowd import Crowd
from frontrunner.paper.exploration import ERROR, RUNTIME, Exploration
from frontrunner.paper.phases import Phases
from pareto.plot.style import DEFAULT, FRONT, LINE, PHASES, SERIES, axis, blank, label, text
from wire.protocol import VALID_BELOW

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

UNITS = {ERROR: "m", RUNTIME: "s a frame"}
BAR = 22  # pixels


def fronts(exploration: Exploration) -> Figure:
    """The measured fronts of each phase and of both, within the limit, beside the predicted front."""
    phases = Phases.of(exploration)
    predicted = np.array([list(values.values()) for _, values in exploration.predicted]).reshape(-1, 2)
    # Name, points, colour and width: the front of both lies below those of the phases, wide and pale.
    shown = (
        ("both, measured", phases.front(), FRONT, 8),
        ("random samples", phases.front(phases.random), PHASES["random"][1], 2),
        ("active learning", phases.front(~phases.random), PHASES["active"][1], 2),
        ("predicted (P)", predicted[predicted[:, 0] < VALID_BELOW], DEFAULT, 0),
    )
    figure = blank(480)
    for name, points, colour, width in shown:
        figure.add_scatter(
            x=points[:, 0],
            y=points[:, 1],
            mode="lines+markers" if width else "markers",
            name=f"{name} ({len(points)})",
            line={"color": colour, "width": width, "shape": "hv"},
            marker={"color": colour, "size": max(width, 6)},
            opacity=0.35 if width > 2 else 1.0,
            hovertemplate=f"{name}<br>%{{x:.4g}} m, %{{y:.4g}} s<extra></extra>",
        )
    every = np.concatenate([points for _, points, _, _ in shown])
    return figure.update_layout(
        xaxis=axis(label(ERROR, UNITS), every[:, 0]), yaxis=axis(label(RUNTIME, UNITS), every[:, 1])
    )


def bars(crowd: Crowd) -> Figure:
    """A bar for each device, fastest on top, with its interval; unconfirmed ones are light."""
    figure = blank(110 + BAR * len(crowd.bars))
    for confirmed, name, colour in ((True, "confirmed", SERIES[0]), (False, "unconfirmed", SERIES[5])):
        rows = [row for row, bar in enumerate(crowd.bars) if bar.confirmed == confirmed]
        chosen = [crowd.bars[row] for row in rows]
        figure.add_bar(
            x=[bar.speedup for bar in chosen],
            y=rows,  # rare models share a label
            orientation="h",
            name=f"{name} ({len(chosen)})",
            marker={"color": colour},
            error_x={
                "type": "data",
                "array": [(bar.high or bar.speedup) - bar.speedup for bar in chosen],
                "arrayminus": [bar.speedup - (bar.low or bar.speedup) for bar in chosen],
                "thickness": 1,
            },
        )
    return figure.update_layout(
        xaxis={"title": {"text": "times as fast as the default on the same device"}, "rangemode": "tozero"},
        yaxis={
            "autorange": "reversed",
            "tickvals": list(range(len(crowd.bars))),
            "ticktext": [text(bar.label) for bar in crowd.bars],
            "gridcolor": LINE,
        },
        barmode="overlay",
    )
