"""The bar chart of the crowd: a bar per device, as in the paper."""

import math
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
from django.urls import reverse
from plotly import graph_objects as go

from crowd.dashboard import formats
from crowd.dashboard.figures.elements import layout, marks
from crowd.dashboard.figures.elements.decimation import decimate, decimation_note
from crowd.dashboard.figures.elements.names import short_names
from crowd.dashboard.figures.palette import Theme
from crowd.devices.naming.chips import OTHER, VENDORS
from crowd.records.speedup import Speedup
from crowd.results.reading.backends import BACKENDS

# With more devices, names do not fit: bars are vertical, names are on hover and in the table.
NAMED_BARS = 30
# With more bars, gaps and centres of whiskers only blur the picture.
DENSE = 200
# Pixels, so that two entries fit side by side on a phone.
LEGEND_ENTRY = 66
# Criteria for colours.
VENDOR, SOC = "vendor", "soc"
# Devices without the name of a system on a chip, in a grey like all others.
UNNAMED = "PC or unknown"
# Groups of systems on a chip that have the grey of a maker.
GREYS = {OTHER: OTHER, UNNAMED: "CPU"}
SOCS = 5  # with colours of their own
# Longest names above vertical bars, which fit into a column of a paper.
LABEL_LENGTH = 30
# Height of a row of labels relative to the bars. Rows stay apart on the lowest plot, a figure for a column.
LABEL_ROW = 0.116


def bars_height(rows: int) -> int:
    """Pixels that speedup_bars needs for `rows` bars, which pages reserve."""
    return 96 + 54 * max(rows, 1) if rows <= NAMED_BARS else 460


def speedup_bars(
    rows: Sequence[Speedup], theme: Theme, by: str = VENDOR, mean: float | None = None
) -> go.Figure:
    """One bar a device and processor, with a line at 1 (no gain); coloured by the maker of the chip that
    computed, or `by` the system on a chip.

    Figures that count come first, largest gain first. Unconfirmed figures follow them and are hollow, suspect
    ones are striped. Whiskers are 95 % intervals over installations, grey ones the interval of the one
    session behind a figure. Up to NAMED_BARS bars lie flat with the name above each; of more, the largest,
    the smallest and the `mean` are named. Of more than decimation.MOST_DRAWN bars every n-th is drawn, and
    the figure says so.
    """
    by_gain = in_order(rows)
    # Only every n-th, so that the outline of the bars stays the same.
    ranked = decimate(by_gain, lambda _: False)
    figure = layout.blank(theme, bars_height(len(ranked)))
    flat = len(ranked) <= NAMED_BARS
    names = bar_names(ranked)
    groups, shown = bar_groups(ranked, by)
    colours = _soc_colours(shown, theme) if by == SOC else {name: theme.families[name] for name in shown}
    for name, colour in colours.items():
        ranks = [rank for rank, other in enumerate(groups) if other == name]
        members = [ranked[rank] for rank in ranks]
        values = [round(row.speedup, 4) for row in members]
        figure.add_bar(
            x=values if flat else ranks,
            y=ranks if flat else values,
            orientation="h" if flat else "v",
            name=layout.text(layout.clipped(name, 24)),
            width=layout.BAR if flat else 0.8 if len(ranked) <= DENSE else 1.0,
            marker=marks.bar_marks(
                members, [colour] * len(members), theme, edge=1.5 if len(ranked) <= DENSE else 0
            ),
            # Plotly copies and checks lists of lists item by item.
            customdata=np.array(
                [[_detail(names[rank], ranked[rank]), _address(ranked[rank])] for rank in ranks],
                dtype=object,
            ),
            hovertemplate="%{customdata[0]}<extra></extra>",
            # Without x and y: no label of the axis beside that of the bar.
            hoverinfo="text",
            showlegend=len(colours) > 1,
        )
    marks.add_legend(figure, ranked, theme)
    _add_intervals(figure, ranked, flat, theme)
    if not ranked:
        layout.note(figure, "No figure to show yet", theme)
    # An uncounted figure may be far larger than all others: it must not flatten them.
    in_sight = [row for row in ranked if row.counts] or ranked
    reach = max([row.high or row.session_high or row.speedup for row in in_sight], default=1.0)
    top = max(reach * 1.06, 1.5)
    values_axis: dict[str, Any] = {
        "title": {"text": "speedup over the default"},
        "range": [0, top],
        "ticksuffix": formats.TIMES,
    }
    no_gain = {"type": "line", "line": {"color": theme.ink, "width": 1.5, "dash": layout.DOTTED}}
    if flat:
        written = [formats.speedup(row.speedup, row.range) for row in ranked]
        layout.name_bars(figure, zip(written, names, strict=True), theme)
        figure.add_shape(x0=1, x1=1, yref="paper", y0=0, y1=1, **no_gain)
        return figure.update_layout(
            xaxis=values_axis,
            yaxis=layout.flat_rows(len(ranked)),
            legend={"entrywidth": LEGEND_ENTRY},
            hovermode="y",
        )
    figure.add_shape(y0=1, y1=1, xref="paper", x0=0, x1=1, **no_gain)
    left_out = decimation_note(len(ranked), len(by_gain))
    devices_axis = {
        "showticklabels": False,
        "showgrid": False,
        "range": [-0.7, len(ranked) - 0.3],
        "title": {"text": "<br>".join(filter(None, (_order(ranked), left_out)))},
    }
    values_axis["range"] = [0, top * (1 + 3 * LABEL_ROW)]
    ticks = round_ticks(top)
    values_axis |= {"tickvals": ticks, "ticktext": [f"{tick:g}{formats.TIMES}" for tick in ticks]}
    _name_extremes(figure, ranked, names, top, mean, theme)
    return figure.update_layout(
        xaxis=devices_axis,
        yaxis=values_axis,
        legend={"entrywidth": LEGEND_ENTRY},
        # The nearest bar responds, because bars may be three pixels wide.
        hovermode="x",
    )


def round_ticks(top: float, most: int = 8) -> list[float]:
    """Round numbers from 0 to `top` in at `most` steps."""
    power = 10.0 ** math.floor(math.log10(top / most))
    step = next(digit * power for digit in (1, 2, 5, 10) if digit * power * most >= top)
    return [number * step for number in range(int(top / step) + 1)]


def _name_extremes(
    figure: go.Figure,
    ranked: Sequence[Speedup],
    names: Sequence[str],
    top: float,
    mean: float | None,
    theme: Theme,
) -> None:
    """Label the largest and the smallest of the counted `ranked` and their `mean`, in rows above `top`.

    A line leads from each label to its bar. In this order, no line crosses another label.
    """
    last = sum(row.counts for row in ranked) or len(ranked)
    shorts = short_names([row.device for row in ranked], LABEL_LENGTH)

    def named(words: str, rank: int) -> tuple[int, float, str]:
        # Keep the part that distinguishes bars of one device.
        part = names[rank].removeprefix(ranked[rank].device.title)
        return rank, ranked[rank].speedup, f"{words}, {layout.clipped(shorts[rank] + part, LABEL_LENGTH)}"

    labels = [(*named("largest", 0), "left"), (*named("smallest", last - 1), "right")]
    if mean is not None:
        # Where the bars pass below it.
        middle = sum(row.speedup > mean for row in ranked[:last])
        labels.append((middle, mean, "mean", "center"))
    step = top * LABEL_ROW
    levels = [top + step * (2.5 - number) for number in range(len(labels))]
    for level, (rank, value, _, _) in zip(levels, labels, strict=True):
        figure.add_shape(
            type="line",
            x0=rank,
            x1=rank,
            y0=value,
            y1=level - step / 3,
            line={"color": theme.muted, "width": 1},
            layer="below",
        )

    figure.update_layout(
        annotations=[
            {
                "x": rank,
                "y": level,
                "text": f"<b>{formats.speedup(value)}</b> {layout.text(words)}",
                "font": {"color": theme.ink, "size": 12},
                "xanchor": anchor,
                "xshift": {"left": -4, "right": 4, "center": 0}[anchor],
                "yanchor": "middle",
                "showarrow": False,
            }
            for level, (rank, value, words, anchor) in zip(levels, labels, strict=True)
        ]
    )


def _order(rows: Sequence[Speedup]) -> str:
    """The order of `rows` in words."""
    apart = any(not row.counts for row in rows) and any(row.counts for row in rows)
    return "largest gain first, others last" if apart else "devices, largest gain first"


def _backend(row: Speedup) -> str:
    return BACKENDS.get(row.backend, row.backend)


# Properties that distinguish the bars of a device. Figures of CPU and GPU are never averaged.
DISTINGUISHING: tuple[Callable[[Speedup], str], ...] = (
    lambda row: row.processor or _backend(row),
    lambda row: row.processor_class.upper(),
    _backend,
    lambda row: row.configuration,
)


def bar_names(rows: Sequence[Speedup]) -> list[str]:
    """The names of `rows`: the device, and in brackets what distinguishes rows of one device."""
    of_device: dict[str, list[Speedup]] = defaultdict(list)
    for row in rows:
        of_device[row.device.slug].append(row)
    needed = {slug: _distinguishing(figures) for slug, figures in of_device.items()}
    return [_bar_name(row, [tell(row) for tell in needed[row.device.slug]]) for row in rows]


def _distinguishing(rows: Sequence[Speedup]) -> list[Callable[[Speedup], str]]:
    """The fewest of DISTINGUISHING that make all of `rows` distinct, otherwise all that differ."""
    needed: list[Callable[[Speedup], str]] = []
    for tell in DISTINGUISHING:
        if len({tuple(part(row) for part in needed) for row in rows}) == len(rows):
            break
        if len({tell(row) for row in rows}) > 1:
            needed.append(tell)
    return needed


def _bar_name(row: Speedup, parts: Sequence[str]) -> str:
    return f"{row.device.title} ({', '.join(parts)})" if parts else row.device.title


def _address(row: Speedup) -> str:
    return reverse("dashboard:device", args=[row.device.slug])


def in_order(rows: Iterable[Speedup]) -> list[Speedup]:
    """`rows` in the order of the bars: those that count first, the largest gain first."""
    return sorted(rows, key=lambda row: (not row.counts, -row.speedup, row.device.slug, row.processor))


def bar_groups(rows: Sequence[Speedup], by: str) -> tuple[list[str], list[str]]:
    """The group of each of `rows`, and all groups in the order of the legend, greys last."""
    if by != SOC:
        present = {row.vendor for row in rows}
        return [row.vendor for row in rows], [name for name in VENDORS if name in present]
    groups = _frequent_socs(rows)
    return groups, [*sorted({*groups} - {*GREYS}), *(name for name in GREYS if name in groups)]


def _frequent_socs(rows: Sequence[Speedup]) -> list[str]:
    """The system on a chip of each of `rows`: OTHER for all but the SOCS frequent ones, or UNNAMED."""
    counts = Counter(row.device.soc for row in rows if row.device.soc)
    kept = {soc for soc, _ in sorted(counts.items(), key=lambda item: (-item[1], item[0]))[:SOCS]}
    return [
        UNNAMED if not row.device.soc else row.device.soc if row.device.soc in kept else OTHER for row in rows
    ]


def _soc_colours(groups: Sequence[str], theme: Theme) -> dict[str, str]:
    """A colour for each of `groups`; a single one has the colour of `best`."""
    if len(groups) == 1:
        return {groups[0]: theme.best}
    greys = {name: theme.families[family] for name, family in GREYS.items() if name in groups}
    return dict(zip(groups, theme.series, strict=False)) | greys


def _add_intervals(figure: go.Figure, ranked: Sequence[Speedup], flat: bool, theme: Theme) -> None:
    """Add whiskers as separate traces: plotly draws end caps even for missing intervals."""
    over_installations = [
        (rank, row.speedup, row.low, row.high)
        for rank, row in enumerate(ranked)
        if row.low is not None and row.high is not None
    ]
    of_one_session = [
        (rank, row.speedup, row.session_low, row.session_high)
        for rank, row in enumerate(ranked)
        if row.low is None and row.session_low is not None and row.session_high is not None
    ]
    _add_whiskers(figure, over_installations, flat, theme.ink, len(ranked) <= DENSE)
    # Whiskers of single sessions of thousands of devices only blur the picture.
    if of_one_session and len(ranked) <= DENSE:
        _add_whiskers(figure, of_one_session, flat, theme.muted, True)


def _add_whiskers(
    figure: go.Figure, due: Sequence[tuple[int, float, float, float]], flat: bool, colour: str, wide: bool
) -> None:
    """`due` has the rank, value, low and high end of each interval."""
    ranks = [rank for rank, *_ in due]
    values = [round(value, 4) for _, value, _, _ in due]
    whiskers = {
        "type": "data",
        "symmetric": False,
        "array": [round(high - value, 4) for _, value, _, high in due],
        "arrayminus": [round(value - low, 4) for _, value, low, _ in due],
        "color": colour,
        "thickness": 1.5 if wide else 1,
        "width": 4 if flat else 0,
    }
    figure.add_scatter(
        x=values if flat else ranks,
        y=ranks if flat else values,
        mode="markers",
        marker={"size": 3, "color": colour, "opacity": float(wide)},
        **{"error_x" if flat else "error_y": whiskers},
        hoverinfo="skip",
        showlegend=False,
    )


def _detail(name: str, row: Speedup) -> str:
    parts = [f"<b>{layout.text(name)}</b>", f"{formats.speedup(row.speedup, row.range)} over its own default"]
    parts += [*layout.interval_words(row), layout.count_words(row)]
    parts.append(f"{row.vendor}, {layout.text(_backend(row))}")
    if row.device.soc:
        parts.append(layout.text(row.device.soc))
    return layout.lines(parts + layout.state_words(row))
