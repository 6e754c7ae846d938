"""Charts of runs: times of frames and of stages."""

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence

import numpy as np
from django.urls import reverse
from plotly import graph_objects as go

from crowd.dashboard import formats
from crowd.dashboard.content.stages import StageTimes, inside_computation, ordered
from crowd.dashboard.figures.elements import heat, layout
from crowd.dashboard.figures.palette import Theme
from crowd.results.reading.rows import RunSeries
from wire.front import BEST, DEFAULT

# Lines of more configurations are hard to follow: each then gets its own row.
MOST_LINES = 5
ROW = 28  # pixels
# The percentiles at the ends of a row's line.
ENDS = (5, 95)
# The height of a row of frames that were left out, as a share of the plot.
SKIPPED = 0.06
# Minimum span of an axis of times, as a ratio, so that jitter of one per cent looks small.
LEAST_RATIO = 1.5
# Of the computation, what lies between its stages.
REST, VISIBLE = "rest", 0.005


def frames_height(configurations: int) -> int:
    """Pixels that frame_lines needs for `configurations`."""
    return 400 if configurations <= MOST_LINES else 90 + ROW * configurations


def stages_height(rows: int, close: bool = False) -> int:
    """Pixels that stage_bars needs for `rows` configurations."""
    return 120 + (ROW if close else 62) * max(rows, 1)


def frame_lines(runs: Sequence[RunSeries], first_counted: int, theme: Theme) -> go.Figure:
    """The computation time of each frame, a line per run, on a logarithmic axis.

    Runs of a configuration share a colour and a legend entry. Frames that are not counted are shaded. Frames
    that a configuration left out are strokes at the bottom, outside the axis. With more than MOST_LINES
    configurations, `frame_rows` is used instead.
    """
    if len({series.run.configuration for series in runs}) > MOST_LINES:
        return frame_rows(runs, first_counted, theme)
    figure = layout.blank(theme, 400)
    colours = layout.configuration_colours([series.run.configuration for series in runs], theme)
    seen: set[str] = set()
    for series in runs:
        name = series.run.configuration
        address = reverse("dashboard:run", args=[series.run.uuid])
        figure.add_scatter(
            x=list(range(len(series.frame_seconds))),
            y=layout.rounded(np.where(series.computed, series.frame_seconds * 1e3, np.nan)),
            mode="lines",
            connectgaps=True,
            name=name,
            legendgroup=name,
            showlegend=name not in seen,
            line={"color": colours[name], "width": 1.75},
            customdata=[[f"{name}, repeat {series.run.repeat + 1}", address]] * len(series.frame_seconds),
            hovertemplate="%{customdata[0]}, frame %{x}: <b>%{y:.3~r} ms</b><extra></extra>",
        )
        seen.add(name)
    _add_skipped(figure, runs, colours)
    if runs:
        layout.shade_uncounted(figure, first_counted, theme)
    return figure.update_layout(
        hovermode="closest",
        xaxis={"title": {"text": "frame"}, "zeroline": False},
        yaxis=_times_axis(runs),
    )


def _add_skipped(figure: go.Figure, runs: Sequence[RunSeries], colours: Mapping[str, str]) -> None:
    """A row of strokes for each configuration that left frames out, on the second y axis."""
    frames: dict[str, set[int]] = defaultdict(set)
    for series in runs:
        frames[series.run.configuration].update(np.flatnonzero(~series.computed).tolist())
    skipping = [name for name, skipped in frames.items() if skipped]
    if skipping:
        figure.update_layout(yaxis2={"overlaying": "y", "range": [0, 1], "visible": False})
    for row, name in enumerate(skipping):
        figure.add_scatter(
            x=sorted(frames[name]),
            y=[SKIPPED * (row + 0.5)] * len(frames[name]),
            yaxis="y2",
            mode="markers",
            name=f"{name}, frame left out",
            marker={"symbol": "line-ns", "size": 8, "line": {"width": 1.5, "color": colours[name]}},
            hovertemplate=f"{layout.text(name)}, frame %{{x}}: left out<extra></extra>",
        )


def _times_axis(runs: Sequence[RunSeries]) -> dict[str, object]:
    """A logarithmic axis for the computed frames of `runs` that spans at least LEAST_RATIO.

    Below them is room for a row for each configuration that left frames out.
    """
    title = "computation, ms a frame (log)"
    computed = [series.frame_seconds[series.computed] * 1e3 for series in runs]
    times = np.concatenate(computed) if runs else np.empty(0)
    times = times[times > 0]
    skipping = len({series.run.configuration for series in runs if not series.computed.all()})
    if not times.size or (times.max() >= LEAST_RATIO * times.min() and not skipping):
        return layout.log_axis(title)
    low, high = math.log10(float(times.min())), math.log10(float(times.max()))
    room = max(math.log10(LEAST_RATIO) - (high - low), 0.1 * (high - low)) / 2
    low, high = low - room, high + room
    low -= (high - low) * SKIPPED * skipping / (1 - SKIPPED * skipping)
    return layout.log_axis(title, [10**low, 10**high]) | {"range": [low, high]}


def frame_rows(runs: Sequence[RunSeries], first_counted: int, theme: Theme) -> go.Figure:
    """The times of counted frames, a row per configuration, fastest on top.

    A large mark is the mean over runs, small ones are means of runs. A line covers most of the computed
    frames: a mean that includes frames left out may be below it.
    """
    times: dict[str, list[np.ndarray]] = {}
    computed: dict[str, list[np.ndarray]] = {}
    for series in runs:
        counted = series.frame_seconds[first_counted:] * 1e3
        if (counted > 0).any():
            times.setdefault(series.run.configuration, []).append(counted[counted > 0])
            those = counted[series.computed[first_counted:]]
            computed.setdefault(series.run.configuration, []).append(those if those.size else counted)
    means = {name: float(np.mean([each.mean() for each in group])) for name, group in times.items()}
    names = sorted(times, key=lambda name: (means[name], name))
    figure = layout.blank(theme, frames_height(len(names)))
    fixed = {DEFAULT: theme.default, BEST: theme.best}
    colours = [fixed.get(name, theme.series[0]) for name in names]
    ends = [np.percentile(np.concatenate(computed[name]), ENDS) for name in names]
    figure.add_scatter(
        x=layout.rounded([x for low, high in ends for x in (low, high, np.nan)]),
        y=[rank for rank in range(len(names)) for _ in range(3)],
        mode="lines",
        line={"width": 1.5, "color": theme.muted},
        hoverinfo="skip",
        showlegend=False,
    )
    figure.add_scatter(
        x=layout.rounded([run.mean() for name in names for run in times[name]]),
        y=[rank for rank, name in enumerate(names) for _ in times[name]],
        mode="markers",
        marker={"size": 14, "symbol": "line-ns", "line": {"width": 1.25, "color": theme.muted}},
        hoverinfo="skip",
        showlegend=False,
    )
    figure.add_scatter(
        x=layout.rounded([means[name] for name in names]),
        y=list(range(len(names))),
        mode="markers",
        marker={"size": 10, "color": colours},
        customdata=[
            layout.lines(
                [
                    f"<b>{layout.text(name)}</b>",
                    f"mean {formats.milliseconds(means[name] / 1e3)} a frame",
                    f"{formats.plural(len(times[name]), 'run')}; 90 % of the computed frames from "
                    f"{formats.milliseconds(low / 1e3)} to {formats.milliseconds(high / 1e3)}",
                ]
            )
            for name, (low, high) in zip(names, ends, strict=True)
        ],
        hovertemplate="%{customdata}<extra></extra>",
        hoverinfo="text",
        showlegend=False,
    )
    reached = [end for pair in ends for end in pair] + list(means.values())
    return figure.update_layout(
        hovermode="y",
        xaxis=layout.log_axis("computation, ms a frame (log)", reached),
        yaxis=named_rows(names),
        margin={"t": 12},
    )


def named_rows(names: Sequence[str]) -> dict[str, object]:
    """A y axis with a name per row, the first on top."""
    return heat.named_axis(names) | {"range": [len(names) - 0.4, -0.6], "showgrid": False}


def stage_bars(rows: Sequence[StageTimes], theme: Theme, close: bool = False) -> go.Figure:
    """Mean time per frame, a bar per configuration, stacked by stage in pipeline order, and last by the rest.

    Names are above the bars; with `close`, for many short names, on the axis.
    """
    figure = layout.blank(theme, stages_height(len(rows), close))
    rest = [row.computation - sum(row.seconds.values()) for row in rows]
    shown = any(each > VISIBLE * row.computation for each, row in zip(rest, rows, strict=True))
    stages = [row.seconds | {REST: max(each, 0.0)} for each, row in zip(rest, rows, strict=True)]
    for stage in [*ordered({stage for row in rows for stage in row.seconds}), *([REST] if shown else [])]:
        figure.add_bar(
            x=layout.rounded([seconds.get(stage, 0.0) * 1e3 for seconds in stages]),
            y=list(range(len(rows))),
            orientation="h",
            name=stage,
            width=0.62 if close else layout.BAR,
            marker={
                "color": theme.stages.get(stage, theme.muted),
                "line": {"width": 1, "color": theme.surface},
            },
            customdata=[row.configuration for row in rows],
            hovertemplate="%{customdata}, " + layout.text(stage) + ": <b>%{x:.3~r} ms</b><extra></extra>",
        )
    if not close:
        names = [(formats.milliseconds(row.computation), row.configuration) for row in rows]
        layout.name_bars(figure, names, theme)
    return figure.update_layout(
        barmode="stack",
        xaxis={"title": {"text": "mean ms a frame"}, "rangemode": "tozero"},
        yaxis=named_rows([row.configuration for row in rows]) if close else layout.flat_rows(len(rows)),
        legend={"traceorder": "normal"},
    )


def stage_areas(series: RunSeries, first_counted: int, theme: Theme) -> go.Figure:
    """The stages of a run, stacked for each frame; without stages, only the computation."""
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
