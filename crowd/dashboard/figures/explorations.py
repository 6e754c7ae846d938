"""An exploration in the plane of error and runtime: everything that was measured, and the front of it."""

import math
from collections.abc import Sequence

from plotly import graph_objects as go

from crowd.dashboard import formats
from crowd.dashboard.figures import layout
from crowd.dashboard.palette import Theme
from crowd.explorations.points import Point

# Metres between which errors are drawn. 0 has no place on a logarithmic axis, and how far a lost camera
# has drifted tells nothing, but would squeeze the rest into a corner.
LEAST_ATE, MOST_ATE = 1e-4, 1.0
# Phases in the order in which they are drawn: later ones lie on top.
PHASES = {"random": "random samples", "active": "active learning", "given": "known before"}


def exploration_plane(
    points: Sequence[Point], front: Sequence[Point], max_ate: float, theme: Theme
) -> go.Figure:
    """Every measured configuration in the plane (max ATE, runtime), and FRONT as the staircase over them.

    Random samples are circles, those of active learning discs, configurations known before diamonds with
    their names. Points without an error (tracking was lost at once) are left out, errors above MOST_ATE are
    drawn there. Both axes are logarithmic.
    """
    figure = layout.blank(theme, 520)
    drawn = placed(points)
    looks = {
        "random": {"symbol": "circle-open", "color": theme.limit, "size": 7},
        "active": {"symbol": "circle", "color": theme.ink, "size": 6},
        "given": {"symbol": "diamond", "color": theme.default, "size": 10},
    }
    for phase, name in PHASES.items():
        members = [point for point in drawn if point.phase == phase]
        if members:
            figure.add_scatter(
                x=_errors(members),
                y=_runtimes(members),
                mode="markers",
                name=f"{name} ({len(members)})",
                marker=looks[phase],
                customdata=[_detail(point) for point in members],
                hovertemplate="%{customdata}<extra></extra>",
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
            customdata=[_detail(point) for point in stairs],
            hovertemplate="%{customdata}<extra></extra>",
        )
    for point in drawn:
        if point.label:
            _add_label(figure, point, theme)
    if drawn:
        layout.limit_line(figure, max_ate * 100, theme, log=True)
    return figure.update_layout(
        xaxis=layout.log_axis("maximum trajectory error, cm (log)"),
        yaxis=layout.log_axis("runtime, ms a frame (log)"),
        legend={"y": 1.05},
        margin={"t": 56},
    )


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


def _detail(point: Point) -> str:
    runtime, ate = point.values["runtime"], point.values["ate_max"]
    head = [f"<b>{layout.text(point.label)}</b>"] if point.label else []
    figures = f"{formats.milliseconds(runtime)} a frame, max ATE {formats.centimetres(ate)}"
    parameters = [
        f"{layout.text(formats.words(name))} {formats.parameter(value)}"
        for name, value in point.configuration.items()
    ]
    return layout.lines([*head, figures, *parameters])
