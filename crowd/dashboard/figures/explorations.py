"""Figures of an exploration: what was measured and its front, how it grew, what a model makes of it."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from plotly import graph_objects as go

from crowd.dashboard import formats
from crowd.dashboard.figures.elements import labels, layout
from crowd.dashboard.figures.elements.decimation import MOST_DRAWN, decimated, said
from crowd.dashboard.palette import Theme
from crowd.explorations.searching.points import Point
from crowd.fronts.content.coverage import LEAST_ATE
from pareto.surrogates.prediction import Prediction

# Metres. Larger errors are drawn here: how far a lost camera has drifted tells nothing, but would squeeze the
# rest into a corner.
MOST_ATE = 1.0
HEIGHT = 520
MARGIN = {"l": 62, "r": 14, "t": 84, "b": 58}
LEAST_SEARCHED = 5  # configurations, on the axis of the growth
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
    figure = layout.blank(theme, HEIGHT)
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
    limit = max_ate * 100
    plane = labels.Plane.around(
        [*(x for x in _errors(drawn) if x), limit],
        [y for y in _runtimes(drawn) if y],
        HEIGHT - MARGIN["t"] - MARGIN["b"],
    )
    # Names keep off the front and off each other: among ten thousand points there is no room.
    spots = _spots([point for point in drawn if point.label] + stairs, plane)
    if drawn:
        layout.limit_line(figure, limit, theme, plane.anchor(limit))
    else:
        layout.note(figure, "Nothing measured yet", theme)
    labels.add(figure, plane, [spot for spot in spots if spot.name], spots, theme)
    if words := said(len(drawn), len(every)):
        layout.corner(figure, words, theme)
    across, up = plane.ranges
    return figure.update_layout(
        xaxis=layout.log_axis("maximum trajectory error, cm (log)", plane.across) | {"range": across},
        yaxis=layout.log_axis("time, ms a frame (log)", plane.up) | {"range": up},
        legend={"y": 1.06},
        margin=MARGIN,
        uirevision="stays",
    )


def growth_line(growth: Sequence[float], random: int, theme: Theme) -> go.Figure:
    """The share (0 to 1) that is covered after each searched measurement, the first RANDOM of them random
    samples.
    """
    figure = layout.blank(theme, 320)
    figure.update_layout(
        xaxis={
            "title": {"text": "configurations searched"},
            "range": [0, max(len(growth), LEAST_SEARCHED) * 1.02],
            "tickformat": ",d",
        },
        yaxis={"title": {"text": "covered, %"}, "range": [0, 105]},
    )
    if not growth:
        return layout.note(figure, "Nothing measured yet", theme)
    rows = range(len(growth)) if len(growth) <= MOST_DRAWN else _corners(growth)
    figure.add_scatter(
        x=[row + 1 for row in rows],
        y=layout.rounded([growth[row] * 100 for row in rows]),
        # One point makes no line.
        mode="lines" if len(rows) > 1 else "markers",
        line={"shape": "hv", "color": theme.best, "width": 2},
        marker={"color": theme.best, "size": 8},
        hovertemplate="after %{x:,} configurations: %{y} %<extra></extra>",
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
        xaxis={"title": {"text": "variance, %"}, "rangemode": "tozero"},
        bargap=0.35,
        legend={"traceorder": "normal"},
    )


def importance_height(parameters: int) -> int:
    """Pixels that the bars of so many parameters need."""
    return 120 + 34 * max(parameters, 3)


def prediction_plane(objective: str, prediction: Prediction | None, theme: Theme) -> go.Figure:
    """What a model predicted of each measurement that it had not seen, against what was measured."""
    figure = layout.blank(theme, 320)
    if prediction is None:
        return layout.note(figure, "Too few measurements to tell", theme)
    scale = formats.OBJECTIVES.get(objective, ("", 1.0))[1]
    measured, predicted = prediction.measured * scale, prediction.predicted * scale
    ends = [float(min(measured.min(), predicted.min())), float(max(measured.max(), predicted.max()))]
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
        y=layout.rounded(predicted),
        mode="markers",
        marker={"color": theme.ink, "size": 5, "opacity": 0.6},
        hovertemplate="measured %{x:.4g}, predicted %{y:.4g}<extra></extra>",
        showlegend=False,
    )
    # Which objective it is stands below the figure: a phone has no room for it on both axes.
    unit = formats.objective(objective).partition(", ")[2]
    titles = [", ".join(filter(None, (word, unit))) for word in ("measured", "predicted")]
    axes = [layout.log_axis(title) if prediction.log else {"title": {"text": title}} for title in titles]
    return figure.update_layout(xaxis=axes[0], yaxis=axes[1])


def _corners(growth: Sequence[float]) -> list[int]:
    """Positions in GROWTH at which it changes, and its ends: the staircase through them is the same."""
    inner = range(1, len(growth) - 1)
    return [0, *(row for row in inner if growth[row] != growth[row - 1]), len(growth) - 1]


def placed(points: Sequence[Point]) -> list[Point]:
    """Those of POINTS that have both an error and a runtime."""
    return [point for point in points if {"ate_max", "runtime"} <= point.values.keys()]


def _spots(points: Sequence[Point], plane: labels.Plane) -> list[labels.Spot]:
    """Where POINTS lie in PLANE, each with the name that it has, if any."""
    pairs = zip(points, _errors(points), _runtimes(points), strict=True)
    return [plane.spot(point.label, x or LEAST_ATE, y or LEAST_ATE) for point, x, y in pairs]


def _errors(points: Sequence[Point]) -> list[float | None]:
    return layout.rounded([min(max(point.values["ate_max"], LEAST_ATE), MOST_ATE) * 100 for point in points])


def _runtimes(points: Sequence[Point]) -> list[float | None]:
    return layout.rounded([point.values["runtime"] * 1e3 for point in points])


def _told(points: Sequence[Point]) -> dict[str, Any]:
    """What hovering over POINTS tells: the names stand in the template once, the values with each point."""
    names = list(dict.fromkeys(name for point in points for name in point.configuration))
    rows = [
        [
            f"<b>{layout.text(formats.configuration(point.label, point.number))}</b><br>",
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
