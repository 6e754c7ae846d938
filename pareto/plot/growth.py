"""How the front grew: fronts after more and more measurements, and the hypervolume after each."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from pareto.fronts.hypervolume import hypervolume_growth
from pareto.plot.arrivals import Arrivals
from pareto.plot.style import PHASES, axis, blank, label, stairs, text

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

# Early fronts light, the last one dark.
SHADES = ("#c6dbef", "#9ecae1", "#6baed6", "#2f7fbc", "#08306b")


def front_over_time(
    arrivals: Arrivals, first: int = 0, second: int = 1, units: Mapping[str, str] | None = None
) -> Figure:
    """Return the fronts of two objectives after 1/16, 1/8, 1/4, 1/2 and all of the measurements."""
    units = units or {}
    total = len(arrivals.indices)
    marks = sorted({max(1, total >> halvings) for halvings in range(len(SHADES))}) if total else []
    figure = blank(440)
    shown: list[int] = []
    for mark, shade in zip(marks, SHADES[len(SHADES) - len(marks) :], strict=True):
        rows = arrivals.front(first, second, mark)
        shown += rows.tolist()
        figure.add_scatter(
            x=arrivals.values[rows, first],
            y=arrivals.values[rows, second],
            mode="lines+markers",
            name=f"after {mark}",
            line={"color": shade, "width": 2, "shape": stairs(arrivals.maximise[first])},
            marker={"color": shade, "size": 5},
            hovertemplate=(
                f"after {mark}<br>{text(arrivals.names[first])} %{{x:.4g}}<br>"
                f"{text(arrivals.names[second])} %{{y:.4g}}<extra></extra>"
            ),
        )
    return figure.update_layout(
        xaxis=axis(label(arrivals.names[first], units), arrivals.values[shown, first]),
        yaxis=axis(label(arrivals.names[second], units), arrivals.values[shown, second]),
    )


def hypervolume_over_evaluations(arrivals: Arrivals) -> Figure:
    """Return the hypervolume after each measurement: red until active learning begins, then black."""
    figure = blank(440)
    volumes = hypervolume_growth(arrivals.values, arrivals.limits, arrivals.maximise)
    numbers = np.arange(1, len(volumes) + 1)
    active = np.flatnonzero(arrivals.phases == "active")
    start = int(active[0]) if len(active) else len(volumes)
    for phase, rows in (("random", slice(0, start)), ("active", slice(max(start - 1, 0), None))):
        if len(numbers[rows]) > (phase == "active"):
            name, colour = PHASES[phase]
            figure.add_scatter(
                x=numbers[rows],
                y=volumes[rows],
                mode="lines",
                name="before learning" if phase == "random" else name,
                line={"color": colour, "width": 2, "shape": "hv"},
                hovertemplate="after %{x}: %{y:.4g}<extra></extra>",
            )
    top = float(volumes.max()) if len(volumes) else 1.0
    return figure.update_layout(
        xaxis={"title": {"text": "evaluations"}, "rangemode": "tozero"},
        yaxis={"title": {"text": "hypervolume"}, "range": [0, 1.05 * (top or 1.0)]},
    )
