"""Figures of an exploration: what was measured and its front, how it grew, what a model makes of it."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from plotly import graph_objects as go

from crowd.dashboard import formats
from crowd.dashboard.figures import layout
from crowd.dashboard.figures.decimation import MOST_DRAWN, decimated, said
from crowd.dashboard.palette import Theme
from crowd.explorations.searching.points import Point
from pareto.surrogates.prediction import Prediction

# Metres between which errors are drawn. 0 has no place on a logarithmic axis, and how far a lost camera
# has drifted tells nothing, but would squeeze the rest into a corner.
LEAST_ATE, MOST_ATE = 1e-4, 1.0
# Phases in the order in which they are drawn: later ones lie on top.
PHASES = {
    "known": "earlier exploration",
    "random": "random samples",
    "active": "active learning",
    "given": "known before",
}


def exploration_plane(
    points: Sequence[Point], front: Sequence[Point], max_ate: float, theme: Theme
) -> go.Figure:
    """Every measured configuration in the plane (max ATE, runtime), and FRONT as the staircase over them.

    Random samples are circles, those of active learning discs, configurations known before diamonds with
    their names. Points without an error (tracking was lost at once) are left out, errors above MOST_ATE are
    drawn there; of more than MOST_DRAWN a regular selection and all of the front are drawn, and the figure
    says so. Both axes are logarithmic.
    """
    figure = layout.blank(theme, 520)
    every = placed(points)
    drawn = decimated(every, lambda point: point.label)
    looks = {
        "random": {"symbol": "circle-open", "color": theme.limit, "size": 7},
        "active": {"symbol": "circle", "color": theme.ink, "size": 6},
        "given": {"symbol": "diamond", "color": theme.default, "size": 10},
        "known": {"symbol": "square-open", "color": theme.default, "size": 7},
    }
    for phase, name in PHASES.items():
        members = [point for point in drawn if point.phase == phase]
        if members:
            figure.add_scatter(
                x=_errors(members),
                y=_runtimes(members),
                mode="markers",
                name=f"{name} ({sum(point.phase == phase for point in every):,})",
                marker=looks[phase],
                **_told(members),
            )
    stairs = sorted(placed(front), key=lambda point: point.values["ate_max"])
    if stairs:
        figure.add_scatter(
            x=_errors(stairs),
            y=_runtimes(stairs),
            mode="lines+markers",
            name=f"front ({len(stairs)})",
            line={"shape": "hv", "color": theme.best, "width": 2},
            marker={"color": theme.best, "size": 8},
            **_told(stairs),
        )
    for point in drawn:
        if point.label:
            _add_label(figure, point, theme)
    if drawn:
        layout.limit_line(figure, max_ate * 100, theme, log=True)
    else:
        layout.note(figure, "Nothing measured yet", theme)
    if words := said(len(drawn), len(every)):
        layout.corner(figure, words, theme)
    return figure.update_layout(
        xaxis=layout.log_axis("maximum trajectory error, cm (log)"),
        yaxis=layout.log_axis("runtime, ms a frame (log)"),
        legend={"y": 1.05},
        margin={"t": 56},
        uirevision="stays",
    )


def hypervolume_line(growth: Sequence[float], random: int, theme: Theme) -> go.Figure:
    """The hypervolume after each searched measurement; the first RANDOM of them were random samples.

    Only its growth means something: it ends where the limits are, or at the worst value measured so far.
    """
    figure = layout.blank(theme, 320)
    figure.update_layout(
        xaxis={"title": {"text": "configurations searched"}, "rangemode": "tozero"},
        yaxis={"title": {"text": "hypervolume"}, "rangemode": "tozero"},
    )
    if not growth:
        return layout.note(figure, "Nothing measured yet", theme)
    rows = range(len(growth)) if len(growth) <= MOST_DRAWN else _corners(growth)
    figure.add_scatter(
        x=[row + 1 for row in rows],
        y=layout.rounded([growth[row] for row in rows]),
        mode="lines",
        line={"shape": "hv", "color": theme.best, "width": 2},
        hovertemplate="after %{x:,} configurations: %{y}<extra></extra>",
        showlegend=False,
    )
    if 0 < random < len(growth):
        layout.upright_line(figure, random, "active learning begins", theme.muted)
    return figure


def importance_bars(shares: Mapping[str, Mapping[str, float] | None], theme: Theme) -> go.Figure:
    """How much each parameter matters to each objective, parameters that matter most on top."""
    told = {objective: share for objective, share in shares.items() if share is not None}
    names = sorted(
        {name for share in told.values() for name in share},
        key=lambda name: max(share[name] for share in told.values()),
    )
    figure = layout.blank(theme, importance_height(len(names)))
    for colour, (objective, share) in zip(theme.series, told.items(), strict=False):
        figure.add_bar(
            x=layout.rounded([share[name] * 100 for name in names]),
            y=[formats.words(name) for name in names],
            orientation="h",
            name=formats.objective(objective),
            marker={"color": colour},
            hovertemplate="%{y}: %{x:.3g} %<extra>%{fullData.name}</extra>",
        )
    if not told:
        layout.note(figure, "Too few measurements to tell", theme)
    return figure.update_layout(
        xaxis={"title": {"text": "share of the variance, %"}, "rangemode": "tozero"},
        bargap=0.35,
        legend={"traceorder": "normal"},
    )


def importance_height(parameters: int) -> int:
    """Pixels that the bars of so many parameters need."""
    return 120 + 44 * max(parameters, 3)


def prediction_plane(objective: str, prediction: Prediction | None, theme: Theme) -> go.Figure:
    """What a model foretold of each measurement that it had not seen, against what was measured."""
    figure = layout.blank(theme, 420)
    if prediction is None:
        return layout.note(figure, "Too few measurements to tell", theme)
    scale = formats.OBJECTIVES.get(objective, ("", 1.0))[1]
    measured, foretold = prediction.measured * scale, prediction.predicted * scale
    ends = [float(min(measured.min(), foretold.min())), float(max(measured.max(), foretold.max()))]
    figure.add_scatter(
        x=ends,
        y=ends,
        mode="lines",
        line={"color": theme.line, "width": 2},
        hoverinfo="skip",
        showlegend=False,
    )
    figure.add_scatter(
        x=layout.rounded(measured),
        y=layout.rounded(foretold),
        mode="markers",
        marker={"color": theme.ink, "size": 5, "opacity": 0.6},
        hovertemplate="measured %{x:.4g}, predicted %{y:.4g}<extra></extra>",
        showlegend=False,
    )
    name = formats.objective(objective)
    if prediction.log:
        axes = layout.log_axis(f"measured: {name}"), layout.log_axis(f"predicted: {name}")
    else:
        axes = {"title": {"text": f"measured: {name}"}}, {"title": {"text": f"predicted: {name}"}}
    return figure.update_layout(xaxis=axes[0], yaxis=axes[1])


def _corners(growth: Sequence[float]) -> list[int]:
    """Positions in GROWTH at which it changes, and its ends: the staircase through them is the same."""
    inner = range(1, len(growth) - 1)
    return [0, *(row for row in inner if growth[row] != growth[row - 1]), len(growth) - 1]


def placed(points: Sequence[Point]) -> list[Point]:
    """Those of POINTS that have both an error and a runtime."""
    return [point for point in points if {"ate_max", "runtime"} <= point.values.keys()]


def _add_label(figure: go.Figure, point: Point, theme: Theme) -> None:
    (error,), (runtime,) = _errors([point]), _runtimes([point])
    figure.add_annotation(
        # Plotly places annotations on a logarithmic axis by exponent.
        x=math.log10(error or LEAST_ATE),
        y=math.log10(runtime or LEAST_ATE),
        text=layout.text(point.label),
        font={"color": theme.ink, "size": 12},
        bgcolor=theme.surface,
        opacity=0.85,
        borderpad=1,
        yanchor="bottom",
        yshift=7,
        showarrow=False,
    )


def _errors(points: Sequence[Point]) -> list[float | None]:
    return layout.rounded([min(max(point.values["ate_max"], LEAST_ATE), MOST_ATE) * 100 for point in points])


def _runtimes(points: Sequence[Point]) -> list[float | None]:
    return layout.rounded([point.values["runtime"] * 1e3 for point in points])


def _told(points: Sequence[Point]) -> dict[str, Any]:
    """What hovering over POINTS tells: the names stand in the template once, the values with each point."""
    names = list(dict.fromkeys(name for point in points for name in point.configuration))
    rows = [
        [
            f"<b>{layout.text(point.label)}</b><br>" if point.label else "",
            formats.milliseconds(point.values["runtime"]),
            ("at least " if point.censored else "") + formats.centimetres(point.values["ate_max"]),
            *(layout.text(formats.parameter(point.configuration.get(name))) for name in names),
        ]
        for point in points
    ]
    parameters = [
        f"{layout.text(formats.words(name))} %{{customdata[{column}]}}"
        for column, name in enumerate(names, 3)
    ]
    head = "%{customdata[0]}%{customdata[1]} a frame, max ATE %{customdata[2]}"
    # An array, of which plotly looks at no element: of lists it copies and checks each one.
    return {
        "customdata": np.array(rows, dtype=object),
        "hovertemplate": layout.lines([head, *parameters]) + "<extra></extra>",
    }
