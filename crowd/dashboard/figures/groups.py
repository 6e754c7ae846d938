"""The chart of a breakdown of the crowd: the mean speedup of each group."""

from collections.abc import Sequence

from plotly import graph_objects as go

from crowd.dashboard import formats
from crowd.dashboard.figures.elements import heat, layout
from crowd.dashboard.figures.palette import Theme
from crowd.results.reading.rows import BreakdownRow

ROW = 26  # pixels


def groups_height(groups: int) -> int:
    """Pixels that group_bars needs."""
    return 80 + ROW * max(groups, 2)


def group_bars(rows: Sequence[tuple[str, BreakdownRow]], theme: Theme) -> go.Figure:
    """The mean speedup of each named group with its 95 % interval, in the order of `rows`."""
    figure = layout.blank(theme, groups_height(len(rows)))
    if not rows:
        return layout.note(figure, "No group has a confirmed figure yet", theme)
    means = [row.figure.mean or 0.0 for _, row in rows]
    intervals = [
        (row.figure.low or mean, row.figure.high or mean) for (_, row), mean in zip(rows, means, strict=True)
    ]
    figure.add_bar(
        x=layout.rounded(means),
        y=list(range(len(rows))),
        orientation="h",
        width=0.62,
        marker={"color": theme.best},
        error_x={
            "type": "data",
            "symmetric": False,
            "array": layout.rounded([high - mean for (_, high), mean in zip(intervals, means, strict=True)]),
            "arrayminus": layout.rounded(
                [mean - low for (low, _), mean in zip(intervals, means, strict=True)]
            ),
            "color": theme.ink,
            "thickness": 1.5,
            "width": 4,
        },
        customdata=[formats.plural(row.figure.devices, "device model") for _, row in rows],
        hovertemplate="<b>%{x:.3~r}" + formats.TIMES + "</b>, %{customdata}<extra></extra>",
        showlegend=False,
    )
    return figure.update_layout(
        xaxis={"title": {"text": "mean speedup"}, "rangemode": "tozero", "ticksuffix": formats.TIMES},
        yaxis=heat.named_axis([name for name, _ in rows])
        | {"range": [len(rows) - 0.4, -0.6], "showgrid": False},
        margin={"t": 12},
    )
