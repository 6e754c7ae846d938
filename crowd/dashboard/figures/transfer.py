"""Charts of transfer: similarity of devices, and the reference's fastest on each device."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from django.urls import reverse
from plotly import graph_objects as go

from crowd.dashboard import formats
from crowd.dashboard.content.transfer import coefficients
from crowd.dashboard.figures.elements import heat, layout
from crowd.dashboard.figures.elements.names import short_names
from crowd.dashboard.figures.palette import Theme
from crowd.results.reading.transferring.rows import CorrelationMatrix, Winner
from wire.front import BEST

CELL = 22  # pixels
BAR = 26
FEW = 6  # devices, of which each is seen by itself
REGRET_HEIGHT = 400
# Longest name on an axis, on a wide page and on a phone; pixels per name.
LETTERS, NARROW_LETTERS = 22, 12
NAME = 15
# Width of the plot on a phone and on a wide page, in pixels.
NARROW_PLOT, WIDE_PLOT = 210, 900


def correlation_height(devices: int) -> int:
    """Pixels that correlation_map needs."""
    return 130 + max(CELL * devices, 160)


def correlation_map(matrix: CorrelationMatrix, kind: str, theme: Theme) -> go.Figure:
    """The coefficients of the `kind` for all pairs of devices, with short names; blank if unknown.

    Colours span the values that occur, up to 1.
    """
    devices = matrix.devices
    figure = layout.blank(theme, correlation_height(len(devices)))
    values = coefficients(matrix, kind)
    if not np.isfinite(values).any():
        return layout.note(figure, "Too few devices with common configurations", theme)
    lowest = float(np.nanmin(values))
    heat.add_cells(
        figure,
        values,
        [
            [_pair(matrix, values, first, second) for second in range(len(devices))]
            for first in range(len(devices))
        ],
        theme,
        zmin=min(np.floor(lowest * 10) / 10, 0.9),
        zmax=1,
        colorbar=heat.bar(theme, f"{kind.title()} correlation of times", nticks=4),
    )
    names, narrow = short_names(devices, LETTERS), short_names(devices, NARROW_LETTERS)
    return figure.update_layout(
        xaxis=_upright_names(names, WIDE_PLOT),
        yaxis=heat.named_axis(names),
        margin={"t": 64},
        # figures.js applies these on a phone.
        meta={
            "narrow": {
                **_paths("xaxis", _upright_names(narrow, NARROW_PLOT)),
                **_paths("yaxis", heat.named_axis(narrow) | {"tickfont": {"size": 11}}),
            }
        },
    )


def _upright_names(names: Sequence[str], pixels: int) -> dict[str, Any]:
    """An x axis with vertical `names` at 0, 1, 2, ...: every n-th, so that they fit into `pixels`."""
    every = max(1, math.ceil(len(names) * NAME / pixels))
    axis = heat.named_axis(names)
    return axis | {
        "tickvals": axis["tickvals"][::every],
        "ticktext": axis["ticktext"][::every],
        "tickangle": -90,
        "tickfont": {"size": 11},
    }


def _paths(axis: str, settings: dict[str, Any]) -> dict[str, Any]:
    """`settings` of `axis` by their paths in a layout, without the title."""
    return {f"{axis}.{name}": value for name, value in settings.items() if name != "title"}


def _pair(matrix: CorrelationMatrix, values: np.ndarray, first: int, second: int) -> str:
    names = [layout.text(matrix.devices[number].title) for number in (first, second)]
    return layout.lines(
        [
            f"<b>{names[0]}</b>",
            f"<b>{names[1]}</b>",
            f"{formats.coefficient(float(values[first, second]))}, "
            f"n = {formats.plural(int(matrix.common[first, second]), 'configuration')}",
        ]
    )


def regret_bars(rows: Sequence[Winner], reference: str, theme: Theme) -> go.Figure:
    """The time of `reference` over that of the fastest configuration, per device, ascending.

    1 means that it is the fastest. `rows` without a regret are left out.
    """
    judged = sorted(
        (row for row in rows if row.regret is not None),
        key=lambda row: (row.regret, row.reference_rank, row.device.slug),
    )
    figure = layout.blank(theme, REGRET_HEIGHT)
    addresses = [reverse("dashboard:device", args=[row.device.slug]) for row in judged]
    words = [_regret(row, reference) for row in judged]
    details = np.array(list(zip(words, addresses, strict=True)), dtype=object).reshape(-1, 2)
    figure.add_bar(
        x=list(range(len(judged))),
        # Bars start at 1: the excess is what a search on the device would gain.
        base=1,
        y=[round((row.regret or 1.0) - 1, 4) for row in judged],
        marker={"color": theme.series[0], "line": {"width": 0}},
        customdata=details,
        hovertemplate="%{customdata[0]}<extra></extra>",
        hoverinfo="text",
        showlegend=False,
    )
    winning = [index for index, row in enumerate(judged) if row.reference_rank == 1]
    figure.add_scatter(
        x=winning,
        y=[1.0] * len(winning),
        mode="markers",
        marker={"color": theme.best, "size": 7},
        # The bar of zero height at this place has the label.
        hoverinfo="skip",
        name=f"{reference} wins here too",
        showlegend=True,
    )
    if not judged:
        layout.note(figure, "No device has measured several configurations yet", theme)
    if len(judged) < FEW:
        # A single bar is not as wide as the plot.
        figure.update_traces(width=0.8 * len(judged) / FEW, selector={"type": "bar"})
    most = max((row.regret or 1.0 for row in judged), default=1.0)
    devices = [row.device for row in judged]
    wide, narrow = (
        _upright_names(short_names(devices, letters), pixels)
        for letters, pixels in ((LETTERS, WIDE_PLOT), (NARROW_LETTERS, NARROW_PLOT))
    )
    return figure.update_layout(
        xaxis=wide | {"title": {"text": "devices, least loss first"}, "showgrid": False},
        meta={"narrow": _paths("xaxis", narrow)},
        hovermode="x",
        yaxis={
            "title": {"text": f"time of {reference} over the device's fastest"},
            "range": [1 - (most - 1) * 0.06 - 0.005, 1 + max((most - 1) * 1.08, 0.05)],
            "ticksuffix": formats.TIMES,
        },
        bargap=0.2,
    )


def _regret(row: Winner, reference: str) -> str:
    return layout.lines(
        [
            f"<b>{layout.text(row.device.title)}</b>",
            f"{layout.text(reference)} takes {formats.speedup(row.regret)} the time of "
            f"{layout.text(row.winner)}",
            f"rank {row.reference_rank} of {formats.plural(row.configurations, 'configuration')}",
        ]
    )


def winners_height(rows: int) -> int:
    """Pixels that winner_bars needs."""
    return 80 + BAR * max(rows, 2)


def winner_bars(counts: Sequence[tuple[str, int]], theme: Theme) -> go.Figure:
    """The number of devices on which each configuration is the fastest, most on top."""
    figure = layout.blank(theme, winners_height(len(counts)))
    figure.add_bar(
        x=[count for _, count in counts],
        y=list(range(len(counts))),
        orientation="h",
        width=0.62,
        marker={"color": [theme.best if name == BEST else theme.series[0] for name, _ in counts]},
        text=[formats.count(count) for _, count in counts],
        textposition="outside",
        textangle=0,
        textfont={"color": theme.ink},
        cliponaxis=False,
        customdata=[layout.text(name) for name, _ in counts],
        hovertemplate="%{customdata} is the fastest on <b>%{x}</b><extra></extra>",
        showlegend=False,
    )
    if not counts:
        layout.note(figure, "No device has measured several configurations yet", theme)
    return figure.update_layout(
        xaxis={
            "title": {"text": "devices"},
            "range": [0, max((count for _, count in counts), default=1) * 1.08],
            "tickformat": "d",
            # A device is not divided.
            "dtick": 1 if max((count for _, count in counts), default=1) < FEW else None,
        },
        yaxis=heat.named_axis([name for name, _ in counts])
        | {"range": [len(counts) - 0.4, -0.6], "showgrid": False},
        margin={"t": 12},
    )
