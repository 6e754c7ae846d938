"""A front in the plane of error and time: predictions of the reference device, and means of the crowd."""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from plotly import graph_objects as go

from crowd.dashboard import formats
from crowd.dashboard.content.points import MeasuredFront, MeasuredPoint
from crowd.dashboard.figures.elements import labels, layout
from crowd.dashboard.figures.palette import Theme, transparent
from crowd.fronts.content.coverage import LEAST_ATE, Rectangle
from pareto.fronts.front import nondominated
from wire.front import BEST, DEFAULT, Point

HEIGHT = 500
MARGIN = {"l": 62, "r": 14, "t": 92, "b": 58}
DIMMED = 0.45


class Drawn(NamedTuple):
    """A point at its error (cm) and time (ms). `best`: valid and not dominated."""

    row: MeasuredPoint
    error: float
    time: float
    valid: bool
    best: bool

    @property
    def point(self) -> Point:
        return self.row.point


class Crowd(NamedTuple):
    """The crowd's mean for a point as a time (ms): that of the default on the reference device over it."""

    drawn: Drawn
    time: float
    low: float
    high: float


def front_plane(shown: MeasuredFront, theme: Theme) -> go.Figure:
    """The configurations of a front in the plane (max ATE, time a frame), both logarithmic.

    A staircase joins the points of the front; others are pale, invalid ones are crosses. The area is the
    covered part of the rectangle. A diamond is the mean of the crowd: the default's time on the reference
    device over the crowd's speedup, at the error of the reference device. It is narrow and grey if it is
    based on fewer devices than others. Points without a prediction are left out.
    """
    figure = layout.blank(theme, HEIGHT)
    drawn = _drawn(shown)
    crowd = list(_crowd(drawn))
    limit = shown.front.protocol.max_ate * 100
    plane = _plane(drawn, crowd, limit)
    stairs = [one for one in drawn if one.best]
    if shown.rectangle:
        _add_area(figure, stairs, shown.rectangle, theme)
    if stairs:
        _add_stairs(figure, stairs, plane, theme)
    _add_links(figure, crowd, theme)
    for name, members, look in (
        ("beaten by another", [one for one in drawn if one.valid and not one.best], {"opacity": DIMMED}),
        ("not valid", [one for one in drawn if not one.valid], {"opacity": DIMMED, "symbol": "x"}),
        ("on the front", stairs, {}),
    ):
        if members:
            figure.add_trace(_marks(name, members, look, theme))
    for few in (True, False):
        means = [one for one in crowd if (one.drawn.row.n < shown.most) == few]
        if means:
            figure.add_trace(_crowd_marks(means, few, theme))
    spots = {one.point.name: plane.spot(one.point.name, one.error, one.time) for one in drawn}
    lines = [[(one.drawn.error, one.low), (one.drawn.error, one.high)] for one in crowd]
    lines += [_staircase(stairs, plane)] if stairs else []
    lines += [[(limit, plane.up[0]), (limit, plane.up[1])]]
    others = [plane.spot("", one.drawn.error, one.time) for one in crowd]
    names = [spots[name] for name in labels.labelled_names(spots)]
    layout.limit_line(figure, limit, theme, plane.anchor(limit))
    along = [spot for line in lines for spot in plane.line(line)]
    labels.add(figure, plane, names, [*spots.values(), *others], theme, along)
    across, up = plane.ranges
    return figure.update_layout(
        xaxis=layout.log_axis("maximum trajectory error, cm (log)", plane.across) | {"range": across},
        yaxis=layout.log_axis("time, ms a frame (log)", plane.up) | {"range": up},
        margin=MARGIN,
        legend={"y": 1.09, "itemclick": False, "itemdoubleclick": False},
    )


def _drawn(shown: MeasuredFront) -> list[Drawn]:
    """The points that can be drawn, most accurate first."""
    rows = [row for row in shown.points if row.point.runtime and row.point.ate_max is not None]
    errors = [max(row.point.ate_max or 0.0, LEAST_ATE) for row in rows]
    times = [row.point.runtime or 0.0 for row in rows]
    limit = shown.front.protocol.max_ate
    # Invalid points do not dominate others.
    table = [(e, t) if e < limit else (np.nan, np.nan) for e, t in zip(errors, times, strict=True)]
    best = nondominated(np.array(table).reshape(-1, 2))
    drawn = [
        Drawn(row, error * 100, time * 1e3, error < limit, bool(on))
        for row, error, time, on in zip(rows, errors, times, best, strict=True)
    ]
    return sorted(drawn, key=lambda one: (one.error, one.time))


def _crowd(drawn: Sequence[Drawn]) -> Iterator[Crowd]:
    default = next((one.time for one in drawn if one.point.name == DEFAULT), None)
    for one in drawn:
        figure = one.row.crowd
        if default and figure and figure.mean:
            time = default / figure.mean
            # There is no interval with fewer than three devices.
            ends = figure.high or figure.mean, figure.low or figure.mean
            yield Crowd(one, time, default / ends[0], default / ends[1])


def _plane(drawn: Sequence[Drawn], crowd: Sequence[Crowd], limit: float) -> labels.Plane:
    errors = [*(one.error for one in drawn), limit]
    times = [*(one.time for one in drawn), *(end for one in crowd for end in (one.low, one.high))]
    return labels.Plane.around(errors, times, HEIGHT - MARGIN["t"] - MARGIN["b"])


def _add_area(figure: go.Figure, stairs: Sequence[Drawn], area: Rectangle, theme: Theme) -> None:
    """Add the part of `area` that the staircase covers, and the outline of `area`."""
    (left, bottom), (right, top) = ((error * 100, time * 1e3) for error, time in area)
    inside = [one for one in stairs if one.error < right and one.time < top]
    xs, ys = [left, left, right, right, left], [bottom, top, top, bottom, bottom]
    look = {"color": theme.best, "width": 1, "dash": layout.DOTTED}
    figure.add_scatter(
        x=layout.rounded(xs), y=layout.rounded(ys), mode="lines", line=look, opacity=0.6,
        hoverinfo="skip", showlegend=False,
    )  # fmt: skip
    if inside:
        corners = _corners(inside)
        corners = [(inside[0].error, top), *corners, (right, inside[-1].time), (right, top)]
        figure.add_scatter(
            x=layout.rounded([x for x, _ in corners]), y=layout.rounded([y for _, y in corners]),
            mode="lines", line={"width": 0}, fill="toself",
            fillcolor=transparent(theme.best, 0.1), hoverinfo="skip", showlegend=False,
        )  # fmt: skip


def _corners(stairs: Sequence[Drawn]) -> list[tuple[float, float]]:
    """The corners of the staircase through `stairs`, which are sorted by error."""
    corners = [(stairs[0].error, stairs[0].time)]
    for before, after in pairwise(stairs):
        corners += [(after.error, before.time), (after.error, after.time)]
    return corners


def _staircase(stairs: Sequence[Drawn], plane: labels.Plane) -> list[tuple[float, float]]:
    """The staircase, extended to the upper and the right edge of `plane`."""
    return [(stairs[0].error, plane.up[1]), *_corners(stairs), (plane.across[1], stairs[-1].time)]


def _add_stairs(figure: go.Figure, stairs: Sequence[Drawn], plane: labels.Plane, theme: Theme) -> None:
    corners = _staircase(stairs, plane)
    figure.add_scatter(
        x=layout.rounded([x for x, _ in corners]),
        y=layout.rounded([y for _, y in corners]),
        mode="lines",
        name="staircase",
        line={"color": theme.best, "width": 1.5},
        hoverinfo="skip",
        showlegend=False,
    )


def _add_links(figure: go.Figure, crowd: Sequence[Crowd], theme: Theme) -> None:
    """Add a thin line from each point to the mean of the crowd."""
    if crowd:
        figure.add_scatter(
            x=[x for one in crowd for x in (*layout.rounded([one.drawn.error] * 2), None)],
            y=[y for one in crowd for y in (*layout.rounded([one.drawn.time, one.time]), None)],
            mode="lines",
            line={"color": theme.muted, "width": 1, "dash": layout.DOTTED},
            hoverinfo="skip",
            showlegend=False,
        )


def _marks(name: str, members: Sequence[Drawn], look: dict[str, Any], theme: Theme) -> go.Scatter:
    colours = {DEFAULT: theme.default, BEST: theme.best}
    # The legend shows the colour of the first point.
    members = sorted(members, key=lambda one: one.point.name in colours)
    opacities = [1 if one.point.name == DEFAULT else look.get("opacity", 1) for one in members]
    return go.Scatter(
        x=layout.rounded([one.error for one in members]),
        y=layout.rounded([one.time for one in members]),
        mode="markers",
        name=name,
        marker={
            "symbol": look.get("symbol", "circle"),
            "size": [15 if one.point.name in colours else 11 for one in members],
            "opacity": opacities,
            "color": [colours.get(one.point.name, theme.series[0]) for one in members],
            "line": {"width": 1.5, "color": theme.surface},
        },
        customdata=[_detail(one.point) for one in members],
        hovertemplate="%{customdata}<extra></extra>",
    )


def _crowd_marks(members: Sequence[Crowd], few: bool, theme: Theme) -> go.Scatter:
    counts = sorted({one.drawn.row.n for one in members})
    devices = f"{counts[0]:,} to {counts[-1]:,}" if len(counts) > 1 else f"{counts[0]:,}"
    noun = "device" if counts == [1] else "devices"
    colour = theme.muted if few else theme.ink
    return go.Scatter(
        x=layout.rounded([one.drawn.error for one in members]),
        y=layout.rounded([one.time for one in members]),
        mode="markers",
        name=f"mean of the crowd, {devices} {noun}",
        marker={
            "symbol": "diamond-tall" if few else "diamond",
            "size": 10,
            "color": colour,
            "line": {"width": 1, "color": theme.surface},
        },
        error_y={
            "type": "data",
            "symmetric": False,
            "array": layout.rounded([one.high - one.time for one in members]),
            "arrayminus": layout.rounded([one.time - one.low for one in members]),
            "color": colour,
            "thickness": 1.25,
            "width": 3,
        },
        customdata=[_crowd_detail(one) for one in members],
        hovertemplate="%{customdata}<extra></extra>",
    )


def _detail(point: Point) -> str:
    parameters = [
        f"{layout.text(formats.words(name))} {layout.text(formats.parameter(value))}"
        for name, value in point.parameters.items()
    ]
    figures = f"{formats.milliseconds(point.runtime)} a frame, max ATE {formats.centimetres(point.ate_max)}"
    return layout.lines([f"<b>{layout.text(point.name)}</b>", figures, *parameters])


def _crowd_detail(one: Crowd) -> str:
    figure = one.drawn.row.crowd
    assert figure is not None  # it has a mean
    return layout.lines(
        [
            f"<b>{layout.text(one.drawn.point.name)}</b>, the crowd",
            f"{formats.speedup(figure.mean)} over the default, "
            f"95 % interval {formats.interval(figure.low, figure.high)}",
            f"n = {formats.plural(figure.devices, 'device')}",
        ]
    )
