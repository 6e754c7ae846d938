"""A front on one device, measured or predicted, in the plane of error and time."""

from collections.abc import Sequence
from typing import Any

from plotly import graph_objects as go

from crowd.dashboard import formats
from crowd.dashboard.content.advice import Advice
from crowd.dashboard.figures.elements import labels, layout
from crowd.dashboard.figures.palette import Theme
from crowd.fronts.content.coverage import LEAST_ATE
from crowd.predictions.expectations import PredictedPoint
from wire.front import BEST, DEFAULT

HEIGHT = 480
MARGIN = {"l": 62, "r": 14, "t": 92, "b": 58}
PROBE_OPACITY = 0.45
BESIDE_SQUARE = 17.0  # pixels from the middle of the recommended point to its name


def device_plane(advice: Advice, theme: Theme) -> go.Figure:
    """The configurations of a front in the plane (largest error, time per frame), with logarithmic axes.

    If the time of the default is unknown, the speedup is drawn instead of the time.

    Measured ones are discs, predicted ones rings with their 95 % intervals, probes small and pale. The
    recommended one has a square around it. Points without an error are left out.
    """
    figure = layout.blank(theme, HEIGHT)
    drawn = [point for point in advice.answer.expectation.points if point.ate_max is not None]
    for probe in (True, False):
        for measured in (False, True):
            series = [point for point in drawn if (point.probe, point.measured) == (probe, measured)]
            default = [point for point in series if point.configuration == DEFAULT and not measured]
            for part in ([point for point in series if point not in default], default):
                if part:
                    figure.add_trace(_marks(part, advice, theme))
    if advice.chosen is not None:
        figure.add_trace(_chosen(advice, advice.chosen, theme))
    limit = advice.limits.max_ate * 100
    plane = labels.Plane.around(
        [*(_centimetres(point) for point in drawn), limit],
        [end for point in drawn for end in _ends(point, advice)],
        HEIGHT - MARGIN["t"] - MARGIN["b"],
    )
    layout.upright_line(
        figure, limit, f"at most {limit:g} cm", theme.limit, log=True, anchor=plane.anchor(limit)
    )
    chosen = advice.chosen.configuration if advice.chosen else ""
    spots = {
        name: plane.spot(
            name, _centimetres(point), _value(point, advice), BESIDE_SQUARE if name == chosen else labels.GAP
        )
        for point in drawn
        for name in [point.configuration]
    }
    seen = [point for point in drawn if not point.probe]
    whiskers = [
        spot
        for point in seen
        for spot in plane.line([(_centimetres(point), end) for end in _ends(point, advice)])
    ]
    named = [spots[name] for name in labels.labelled_names(spots, chosen)]
    labels.add(figure, plane, named, [spots[one.configuration] for one in seen], theme, whiskers)
    timed = advice.answer.expectation.seconds is not None
    title = "ms a frame on this device (log)" if timed else "times as fast as the default (log)"
    across, up = plane.ranges
    return figure.update_layout(
        xaxis=layout.log_axis("largest trajectory error, cm (log)", plane.across) | {"range": across},
        yaxis=layout.log_axis(title, plane.up) | {"range": up},
        showlegend=True,
        legend={"y": 1.09, "itemclick": False, "itemdoubleclick": False},
        margin=MARGIN,
    )


def _marks(points: Sequence[PredictedPoint], advice: Advice, theme: Theme) -> go.Scatter:
    """A trace of `points`, which are all measured or all predicted, and all probes or none.

    The default has no interval, because the others are compared with it.
    """
    colours = {DEFAULT: theme.default, BEST: theme.best}
    # The legend shows the colour of the first point.
    points = sorted(points, key=lambda point: point.configuration in colours)
    measured, probe = points[0].measured, points[0].probe
    exact = measured or points[0].configuration == DEFAULT
    words = "measured here" if measured else "predicted, 95 % interval"
    return go.Scatter(
        x=layout.rounded([_centimetres(point) for point in points]),
        y=layout.rounded([_value(point, advice) for point in points]),
        mode="markers",
        name=f"probe, {words.partition(',')[0]}" if probe else words,
        marker={
            "symbol": "circle" if measured else "circle-open",
            "size": 7 if probe else 12,
            "opacity": PROBE_OPACITY if probe else 1,
            "color": [colours.get(point.configuration, theme.series[0]) for point in points],
            # The colour of a disc's edge; that of a ring is its own.
            "line": {"width": 1 if probe else 2} | ({"color": theme.surface} if measured else {}),
        },
        showlegend=measured or not exact,
        legendrank=1001 if probe else 1000,
        error_y=None if exact else _interval(points, advice, theme.line if probe else theme.muted),
        customdata=[_detail(point, advice) for point in points],
        hovertemplate="%{customdata}<extra></extra>",
    )


def _interval(points: Sequence[PredictedPoint], advice: Advice, colour: str) -> dict[str, Any]:
    values = [_value(point, advice) for point in points]
    ends = [_ends(point, advice) for point in points]
    return {
        "type": "data",
        "symmetric": False,
        "array": layout.rounded([high - value for value, (_, high) in zip(values, ends, strict=True)]),
        "arrayminus": layout.rounded([value - low for value, (low, _) in zip(values, ends, strict=True)]),
        "color": colour,
        "thickness": 1.25,
        "width": 3,
    }


def _chosen(advice: Advice, point: PredictedPoint, theme: Theme) -> go.Scatter:
    return go.Scatter(
        x=layout.rounded([_centimetres(point)]),
        y=layout.rounded([_value(point, advice)]),
        mode="markers",
        name="recommended",
        marker={
            "symbol": "square-open",
            "size": 24,
            "color": theme.ink,
            "line": {"width": 2},
        },
        hoverinfo="skip",
    )


def _centimetres(point: PredictedPoint) -> float:
    return max(point.ate_max or 0.0, LEAST_ATE) * 100


def _value(point: PredictedPoint, advice: Advice) -> float:
    """The value of `point` on the second axis: ms per frame, or speedup."""
    seconds = advice.seconds(point)
    return point.ratio if seconds is None else seconds * 1e3


def _ends(point: PredictedPoint, advice: Advice) -> tuple[float, float]:
    """The interval of `point` on the second axis, lower end first."""
    seconds = advice.answer.expectation.seconds
    return (
        (point.low, point.high)
        if seconds is None
        else (seconds / point.high * 1e3, seconds / point.low * 1e3)
    )


def _detail(point: PredictedPoint, advice: Advice) -> str:
    state = "measured here" if point.measured else "predicted"
    seconds = advice.seconds(point)
    ratio = f"{formats.speedup(point.ratio)} over the default, {state}"
    if point.configuration != DEFAULT:
        ratio += f", 95 % interval {formats.interval(point.low, point.high)}"
    time = "" if seconds is None else f"{formats.milliseconds(seconds)} a frame, "
    return layout.lines(
        [
            f"<b>{layout.text(point.configuration)}</b>",
            ratio,
            f"{time}largest error {formats.centimetres(point.ate_max)}",
        ]
    )
