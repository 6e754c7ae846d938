"""Charts of an exploration: measurements and front, growth, and a model of the measurements."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from plotly import graph_objects as go

from crowd.dashboard import formats
from crowd.dashboard.figures.elements import labels, layout
from crowd.dashboard.figures.elements.decimation import MOST_DRAWN, decimate, decimation_note
from crowd.dashboard.figures.palette import Theme
from crowd.explorations.searching.applications import SYSTEM
from crowd.explorations.searching.points import Point
from crowd.fronts.content.coverage import LEAST_ATE
from pareto.surrogates.prediction import Prediction

# Metres. Larger errors are drawn here: the drift of a lost camera is meaningless, and would squeeze the rest.
MOST_ATE = 1.0
HEIGHT = 520
MARGIN = {"l": 62, "r": 14, "t": 84, "b": 58}
LEAST_SEARCHED = 5  # configurations, on the axis of the growth
# Phases in drawing order: later ones are on top.
PHASES = {
    "known": "earlier exploration",
    "random": "random samples",
    "active": "active learning",
    "given": "known before",
}


def exploration_plane(
    points: Sequence[Point],
    front: Sequence[Point],
    max_ate: float,
    theme: Theme,
    random_front: Sequence[tuple[float, float]] = (),
) -> go.Figure:
    """All measured configurations in the plane (max ATE, runtime), with `front` as a staircase.

    `random_front` has error and time of the front that random sampling found by itself: a dotted staircase.
    Random samples are circles, those of active learning discs, configurations known before named diamonds.
    Points without an error are left out; errors above MOST_ATE are drawn there. Of more than MOST_DRAWN
    points, every n-th and the whole front are drawn, with a note. Of several systems, the colour says
    which one runs a configuration. Both axes are logarithmic.
    """
    figure = layout.blank(theme, HEIGHT)
    every = placed(points)
    drawn = decimate(every, lambda point: point.label)
    looks = {
        "random": {"symbol": "circle-open", "color": theme.limit, "size": 7},
        "active": {"symbol": "circle", "color": theme.ink, "size": 6},
        "given": {"symbol": "diamond", "color": theme.default, "size": 10},
        "known": {"symbol": "square-open", "color": theme.default, "size": 7},
    }
    colours = _system_colours(every, theme)
    for phase, name in PHASES.items():
        members = [point for point in drawn if point.phase == phase]
        if members:
            figure.add_scatter(
                x=_errors(members),
                y=_runtimes(members),
                mode="markers",
                name=f"{name} ({sum(point.phase == phase for point in every):,})",
                marker=looks[phase] | _coloured(members, colours),
                **_brief_hover(members),
            )
    if random_front:
        figure.add_scatter(
            x=layout.rounded([max(ate, LEAST_ATE) * 100 for ate, _ in random_front]),
            y=layout.rounded([runtime * 1e3 for _, runtime in random_front]),
            mode="lines",
            name=f"front of random samples ({len(random_front)})",
            line={"shape": "hv", "color": theme.limit, "width": 1.5, "dash": layout.DOTTED},
            hoverinfo="skip",
        )
    stairs = sorted(placed(front), key=lambda point: point.values["ate_max"])
    if stairs:
        figure.add_scatter(
            x=_errors(stairs),
            y=_runtimes(stairs),
            mode="lines+markers",
            name=f"front ({len(stairs)})",
            line={"shape": "hv", "color": theme.best, "width": 2},
            marker={"color": theme.best, "size": 8} | _coloured(stairs, colours),
            **_hover(stairs),
        )
    for system, colour in colours.items():  # the legend of the colours
        figure.add_scatter(
            x=[None], y=[None], mode="markers", name=formats.application(system), marker={"color": colour}
        )
    limit = max_ate * 100
    plane = labels.Plane.around(
        [*(x for x in _errors(drawn) if x), limit],
        [y for y in _runtimes(drawn) if y],
        HEIGHT - MARGIN["t"] - MARGIN["b"],
    )
    spots = _spots([*drawn, *stairs], plane)
    if drawn:
        layout.limit_line(figure, limit, theme, plane.anchor(limit))
    else:
        layout.note(figure, "Nothing measured yet", theme)
    named = {spot.name: spot for spot in spots if spot.name}
    labels.add(figure, plane, [named[name] for name in labels.labelled_names(named)], spots, theme)
    if words := decimation_note(len(drawn), len(every)):
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
    """The covered share of the hypervolume (0 to 1) after each searched measurement.

    The first `random` ones are samples.
    """
    figure = layout.blank(theme, 320)
    figure.update_layout(
        xaxis={
            "title": {"text": "configurations searched"},
            "range": [0, max(len(growth), LEAST_SEARCHED) * 1.02],
            "tickformat": ",d",
        },
        yaxis={"title": {"text": "hypervolume covered, %"}, "range": [0, 105]},
    )
    if not growth:
        return layout.note(figure, "Nothing measured yet", theme)
    rows = range(len(growth)) if len(growth) <= MOST_DRAWN else _corners(growth)
    figure.add_scatter(
        x=[row + 1 for row in rows],
        y=layout.rounded([growth[row] * 100 for row in rows]),
        # A line needs two points.
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
    """The importance of each parameter for each objective, most important on top; equal ones by name."""
    known = {objective: share for objective, share in shares.items() if share is not None}
    names = sorted(
        {name for share in known.values() for name in share},
        key=lambda name: (max(share[name] for share in known.values()), name),
    )
    figure = layout.blank(theme, importance_height(len(names)))
    for colour, (objective, share) in zip(theme.series, known.items(), strict=False):
        figure.add_bar(
            x=layout.rounded([share[name] * 100 for name in names]),
            y=[formats.words(name) for name in names],
            orientation="h",
            name=formats.objective(objective),
            marker={"color": colour},
            hovertemplate="%{y}: %{x:.3g} %<extra>%{fullData.name}</extra>",
        )
    if not known:
        layout.note(figure, "Too few measurements", theme)
    return figure.update_layout(
        xaxis={"title": {"text": "variance, %"}, "rangemode": "tozero"},
        bargap=0.35,
        legend={"traceorder": "normal"},
    )


def importance_height(parameters: int) -> int:
    """Pixels for the bars of `parameters`."""
    return 120 + 34 * max(parameters, 3)


def prediction_plane(objective: str, prediction: Prediction | None, theme: Theme) -> go.Figure:
    """Predicted against measured values.

    Each prediction is by trees that were not trained on the measurement.
    """
    figure = layout.blank(theme, 320)
    if prediction is None:
        return layout.note(figure, "Too few measurements", theme)
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
    # The caption names the objective: a phone has no room for it on both axes.
    unit = formats.objective(objective).partition(", ")[2]
    titles = [", ".join(filter(None, (word, unit))) for word in ("measured", "predicted")]
    axes = [layout.log_axis(title) if prediction.log else {"title": {"text": title}} for title in titles]
    return figure.update_layout(xaxis=axes[0], yaxis=axes[1])


def _corners(growth: Sequence[float]) -> list[int]:
    """The indices at which `growth` changes, and its ends: they define the same staircase."""
    inner = range(1, len(growth) - 1)
    return [0, *(row for row in inner if growth[row] != growth[row - 1]), len(growth) - 1]


def placed(points: Sequence[Point]) -> list[Point]:
    """The `points` that have both an error and a runtime."""
    return [point for point in points if {"ate_max", "runtime"} <= point.values.keys()]


def _system_colours(points: Sequence[Point], theme: Theme) -> dict[str, str]:
    """A colour for each system of `points` where their space is over several; else none."""
    present = {str(point.configuration[SYSTEM]) for point in points if SYSTEM in point.configuration}
    return dict(zip(sorted(present), theme.series, strict=False))


def _coloured(points: Sequence[Point], colours: Mapping[str, str]) -> dict[str, Any]:
    return {"color": [colours[point.configuration[SYSTEM]] for point in points]} if colours else {}


def _spots(points: Sequence[Point], plane: labels.Plane) -> list[labels.Spot]:
    """The spots of `points` in `plane`, with their names, if any."""
    pairs = zip(points, _errors(points), _runtimes(points), strict=True)
    return [plane.spot(point.label, x or LEAST_ATE, y or LEAST_ATE) for point, x, y in pairs]


def _errors(points: Sequence[Point]) -> list[float | None]:
    return layout.rounded([min(max(point.values["ate_max"], LEAST_ATE), MOST_ATE) * 100 for point in points])


def _runtimes(points: Sequence[Point]) -> list[float | None]:
    return layout.rounded([point.values["runtime"] * 1e3 for point in points])


def _brief_hover(points: Sequence[Point]) -> dict[str, Any]:
    """The hover labels of many `points`: what their places do not say. The front's have all parameters."""
    return {
        "customdata": np.array(
            [
                [formats.configuration(layout.text(point.label), point.number), _bound(point)]
                for point in points
            ],
            dtype=object,
        ),
        "hovertemplate": "<b>%{customdata[0]}</b><br>%{y:.4~g} ms a frame, max ATE %{customdata[1]}"
        "%{x:.4~g} cm<extra></extra>",
    }


def _bound(point: Point) -> str:
    """What stands before an error that is drawn where it is not."""
    if point.values["ate_max"] > MOST_ATE:
        return "over "
    return "at least " if point.censored else ""


def _hover(points: Sequence[Point]) -> dict[str, Any]:
    """The hover labels of `points`: parameter names once in the template, values with each point."""
    names = list(dict.fromkeys(name for point in points for name in point.configuration))
    rows = [
        [
            f"<b>{layout.text(formats.configuration(point.label, point.number))}</b><br>",
            formats.milliseconds(point.values["runtime"]),
            point.least + formats.centimetres(point.values["ate_max"]),
            *(layout.text(formats.parameter(point.configuration.get(name))) for name in names),
        ]
        for point in points
    ]
    parameters = [
        f"{layout.text(formats.words(name))} %{{customdata[{column}]}}"
        for column, name in enumerate(names, 3)
    ]
    head = "%{customdata[0]}%{customdata[1]} a frame, max ATE %{customdata[2]}"
    # An array is faster: plotly copies and checks each element of lists.
    return {
        "customdata": np.array(rows, dtype=object),
        "hovertemplate": layout.lines([head, *parameters]) + "<extra></extra>",
    }
