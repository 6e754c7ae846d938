"""A front in the plane of error and runtime."""

from collections.abc import Sequence

from plotly import graph_objects as go

from crowd.dashboard import formats
from crowd.dashboard.figures import layout
from crowd.dashboard.palette import Theme
from crowd.fronts.selectors import BEST, DEFAULT, Point

# More names than this run into each other; the others are in the table and on hover.
NAMED_POINTS = 9


def front_plane(points: Sequence[Point], max_ate: float, theme: Theme) -> go.Figure:
    """Published configurations in the plane (max ATE, runtime), with the line at MAX_ATE (m).

    Valid points are discs, invalid ones crosses. Points without a prediction are left out.
    """
    figure = layout.blank(theme, 460)
    drawn = [point for point in points if point.runtime and point.ate_max is not None]
    colours = {DEFAULT: theme.default, BEST: theme.best}
    named = _named(drawn)
    for point in drawn:
        figure.add_scatter(
            x=layout.rounded([(point.ate_max or 0.0) * 100]),
            y=layout.rounded([(point.runtime or 0.0) * 1e3]),
            mode="markers+text" if point.name in named else "markers",
            text=[layout.text(point.name)],
            textposition="top center",
            textfont={"color": theme.ink, "size": 13},
            cliponaxis=False,
            name=point.name,
            marker={
                "symbol": "circle" if (point.ate_max or 0.0) < max_ate else "x",
                "size": 15 if point.name in colours else 11,
                "color": colours.get(point.name, theme.series[0]),
                "line": {"width": 1.5, "color": theme.surface},
            },
            hovertemplate=_detail(point) + "<extra></extra>",
            showlegend=False,
        )
    widest = max([(point.ate_max or 0.0) * 100 for point in drawn], default=0.0)
    layout.limit_line(figure, max_ate * 100, theme)
    return figure.update_layout(
        xaxis={
            "title": {"text": "maximum trajectory error, cm"},
            "range": [0, max(widest, max_ate * 100) * 1.12],
        },
        yaxis=layout.log_axis("runtime, ms a frame (log)", [(point.runtime or 0.0) * 1e3 for point in drawn]),
    )


def _named(points: Sequence[Point]) -> set[str]:
    """Whose names there is room for: all of a few, else default, best and the most accurate."""
    if len(points) <= NAMED_POINTS:
        return {point.name for point in points}
    return {DEFAULT, BEST, min(points, key=lambda point: point.ate_max or 0.0).name}


def _detail(point: Point) -> str:
    parameters = [
        f"{layout.text(name)} {formats.parameter(value)}" for name, value in point.parameters.items()
    ]
    figures = f"{formats.milliseconds(point.runtime)} a frame, max ATE {formats.centimetres(point.ate_max)}"
    # Braces would be read as a field of the hover template.
    return (
        layout.lines([f"<b>{layout.text(point.name)}</b>", figures, *parameters])
        .replace("{", "(")
        .replace("}", ")")
    )
