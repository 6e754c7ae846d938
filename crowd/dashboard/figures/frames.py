"""Charts of single runs: frame by frame, and where the time goes."""

from collections.abc import Sequence

from django.urls import reverse
from plotly import graph_objects as go

from crowd.dashboard import formats
from crowd.dashboard.figures import layout
from crowd.dashboard.palette import Theme
from crowd.dashboard.stages import StageTimes, inside_computation, ordered
from crowd.results.reading.rows import RunSeries


def stages_height(rows: int) -> int:
    """Pixels that stage_bars needs for ROWS configurations."""
    return 120 + 62 * max(rows, 1)


def frame_lines(runs: Sequence[RunSeries], first_counted: int, theme: Theme) -> go.Figure:
    """Computation time of each frame, one line a run, on a logarithmic axis where equal distances are
    equal ratios.

    Runs of one configuration share a colour and a place in the legend. Frames that no statistic counts
    are shaded.
    """
    figure = layout.blank(theme, 400)
    colours = layout.configuration_colours([series.run.configuration for series in runs], theme)
    seen: set[str] = set()
    for series in runs:
        name = series.run.configuration
        address = reverse("dashboard:run", args=[series.run.uuid])
        figure.add_scatter(
            x=list(range(len(series.frame_seconds))),
            y=layout.rounded(series.frame_seconds * 1e3),
            mode="lines",
            name=name,
            legendgroup=name,
            showlegend=name not in seen,
            line={"color": colours[name], "width": 1.75},
            customdata=[[f"{name}, repeat {series.run.repeat + 1}", address]] * len(series.frame_seconds),
            hovertemplate="%{customdata[0]}, frame %{x}: <b>%{y:.3~r} ms</b><extra></extra>",
        )
        seen.add(name)
    if runs:
        layout.shade_uncounted(figure, first_counted, theme)
    return figure.update_layout(
        hovermode="closest",
        xaxis={"title": {"text": "frame"}, "zeroline": False},
        yaxis=layout.log_axis("computation, ms a frame (log)"),
    )


def stage_bars(rows: Sequence[StageTimes], theme: Theme) -> go.Figure:
    """Mean time a frame of each configuration: one bar each, stacked by stage in the pipeline's order."""
    figure = layout.blank(theme, stages_height(len(rows)))
    for stage in ordered({stage for row in rows for stage in row.seconds}):
        figure.add_bar(
            x=layout.rounded([row.seconds.get(stage, 0.0) * 1e3 for row in rows]),
            y=list(range(len(rows))),
            orientation="h",
            name=stage,
            width=layout.BAR,
            marker={
                "color": theme.stages.get(stage, theme.muted),
                "line": {"width": 1, "color": theme.surface},
            },
            customdata=[row.configuration for row in rows],
            hovertemplate="%{customdata}, " + layout.text(stage) + ": <b>%{x:.3~r} ms</b><extra></extra>",
        )
    names = [(formats.milliseconds(row.computation), row.configuration) for row in rows]
    layout.name_bars(figure, names, theme)
    return figure.update_layout(
        barmode="stack",
        xaxis={"title": {"text": "mean ms a frame"}, "rangemode": "tozero"},
        yaxis=layout.flat_rows(len(rows)),
        legend={"traceorder": "normal"},
    )


def stage_areas(series: RunSeries, first_counted: int, theme: Theme) -> go.Figure:
    """Stages of one run stacked frame by frame; a run that told no stages gets its computation alone."""
    figure = layout.blank(theme, 400)
    stages = inside_computation(series) or {"computation": series.frame_seconds}
    for stage, seconds in stages.items():
        colour = theme.stages.get(stage, theme.muted)
        figure.add_scatter(
            x=list(range(len(seconds))),
            y=layout.rounded(seconds * 1e3),
            mode="lines",
            stackgroup="stages",
            name=stage,
            line={"width": 0, "color": colour, "shape": "hvh"},
            fillcolor=colour,
            hovertemplate="<b>%{y:.3~r} ms</b>",
        )
    layout.shade_uncounted(figure, first_counted, theme)
    return figure.update_layout(
        hovermode="x unified",
        xaxis={"title": {"text": "frame"}, "zeroline": False, "hoverformat": "d"},
        yaxis={"title": {"text": "ms a frame"}, "rangemode": "tozero"},
        legend={"traceorder": "normal"},
        showlegend=True,
    )
