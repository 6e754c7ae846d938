"""What a model learns from the measurements: which parameter matters, and how well it predicts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from pareto.plot.arrivals import Arrivals
from pareto.plot.style import LIMIT, PHASES, SERIES, axis, blank, label, text
from pareto.surrogates.bagging import Bagging, grow
from pareto.surrogates.importance import shares
from pareto.surrogates.prediction import Prediction

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

FAILING = "failing"
LEAST_FAILURES = 20  # failures needed to learn what makes a measurement fail


def grown(arrivals: Arrivals) -> dict[str, Bagging]:
    """Return a forest for each objective that can be learnt, and one for failures."""
    columns = dict(zip(arrivals.names, arrivals.values.T, strict=True))
    failed = np.isin(arrivals.indices, arrivals.explorer.history.failed())
    if LEAST_FAILURES <= failed.sum() <= len(failed) - LEAST_FAILURES and FAILING not in columns:
        columns[FAILING] = np.where(failed, 0.0, -1.0)
    space = arrivals.explorer.space
    forests = {name: grow(space, arrivals.indices, values) for name, values in columns.items()}
    return {name: forest for name, forest in forests.items() if forest is not None}


def importances(arrivals: Arrivals, forests: Mapping[str, Bagging]) -> dict[str, dict[str, float]]:
    """Return the parameters' shares of the variance of each forest's objective."""
    names = arrivals.explorer.space.names
    return {name: dict(zip(names, shares(forest), strict=True)) for name, forest in forests.items()}


def parameter_importance(found: Mapping[str, Mapping[str, float]]) -> Figure:
    """Return a bar an objective for each parameter, the most important parameter on top."""
    parameters = list(next(iter(found.values()), {}))
    parameters.sort(key=lambda name: max(share[name] for share in found.values()))
    figure = blank(120 + max(1, len(parameters)) * (14 + 12 * len(found)))
    for number, (name, share) in enumerate(found.items()):
        colour = LIMIT if name == FAILING else SERIES[number % len(SERIES)]
        figure.add_bar(
            x=[share[parameter] for parameter in parameters],
            y=[text(parameter) for parameter in parameters],
            orientation="h",
            name=text(name),
            marker={"color": colour},
            hovertemplate=f"%{{y}}: %{{x:.1%}} of {text(name)}<extra></extra>",
        )
    return figure.update_layout(
        barmode="group",
        bargap=0.3,
        xaxis={"title": {"text": "share of the variance"}, "tickformat": ".0%", "rangemode": "tozero"},
        yaxis={"ticks": "", "showline": False},
        legend={"traceorder": "normal"},
    )


def predicted_against_measured(
    arrivals: Arrivals, name: str, prediction: Prediction, units: Mapping[str, str] | None = None
) -> Figure:
    """Return each measurement of one objective against its out-of-bag prediction."""
    figure = blank(440)
    ends = [
        min(prediction.measured.min(), prediction.predicted.min()),
        max(prediction.measured.max(), prediction.predicted.max()),
    ]
    figure.add_scatter(
        x=ends,
        y=ends,
        mode="lines",
        line={"color": LIMIT, "dash": "dash"},
        showlegend=False,
        hoverinfo="skip",
    )
    phases = arrivals.phases[prediction.rows]
    for phase in dict.fromkeys([*PHASES, *phases.tolist()]):
        rows = np.flatnonzero(phases == phase)
        if len(rows):
            title, colour = PHASES.get(phase, (phase, "#8c8c8c"))
            figure.add_scatter(
                x=prediction.measured[rows],
                y=prediction.predicted[rows],
                mode="markers",
                name=title,
                marker={"color": colour, "size": 5, "opacity": 0.5},
                hovertemplate="measured %{x:.4g}<br>predicted %{y:.4g}<extra></extra>",
            )
    title = label(name, units or {})
    both = [*prediction.measured.tolist(), *prediction.predicted.tolist()]
    return figure.update_layout(
        xaxis=axis(f"{title}, measured", both), yaxis=axis(f"{title}, predicted", both)
    )
