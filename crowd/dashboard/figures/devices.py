"""Charts of one device: configurations, place in the crowd, history, drift, sensors."""

from collections.abc import Sequence

import numpy as np
from django.urls import reverse
from plotly import graph_objects as go

from crowd.dashboard import formats
from crowd.dashboard.content.drift import Readings, Step
from crowd.dashboard.figures.elements import layout, marks
from crowd.dashboard.figures.palette import Theme, mixed
from crowd.records.speedup import Speedup
from crowd.results.reading.rows import Ranking, Release
from wire.front import BEST, DEFAULT
from wire.protocol import MAX_DRIFT

ROW = 28  # height of a bar, pixels
SENSOR = 130  # height of a sensor's plot, pixels
# Minimum span of a sensor's axis, by unit: a clock that changes by 1 MHz looks flat.
LEAST_SPAN = {"MHz": 500.0, "°C": 10.0, "%": 10.0}
# Colours of more configurations cannot be distinguished.
MOST_COLOURED = 5


def configurations_height(rows: int) -> int:
    """Pixels that configuration_bars needs."""
    return 90 + ROW * max(rows, 2)


def configuration_bars(rows: Sequence[Speedup], theme: Theme) -> go.Figure:
    """Bars of all configurations on one device, largest speedup first, with their intervals.

    `best` has its colour; unconfirmed figures are hollow, suspect ones striped. `rows` have one front,
    backend and processor.
    """
    ranked = sorted(rows, key=lambda row: (-row.speedup, row.configuration))
    figure = layout.blank(theme, configurations_height(len(ranked)))
    figure.add_bar(
        x=[round(row.speedup, 4) for row in ranked],
        y=list(range(len(ranked))),
        orientation="h",
        width=0.62,
        marker=marks.bar_marks(
            ranked,
            [theme.best if row.configuration == BEST else theme.series[0] for row in ranked],
            theme,
        ),
        customdata=[_detail(row) for row in ranked],
        hovertemplate="%{customdata}<extra></extra>",
        showlegend=False,
    )
    marks.add_legend(figure, ranked, theme)
    _add_intervals(figure, list(enumerate(ranked)), theme)
    figure.add_scatter(
        # Beyond the whisker, which would otherwise cross the text.
        x=[round(row.high or row.speedup, 4) for row in ranked],
        y=list(range(len(ranked))),
        mode="text",
        text=[f" {formats.speedup(row.speedup, row.range)}" for row in ranked],
        textposition="middle right",
        textfont={"color": theme.ink},
        cliponaxis=False,
        hoverinfo="skip",
        showlegend=False,
    )
    figure.add_shape(
        type="line",
        x0=1,
        x1=1,
        yref="paper",
        y0=0,
        y1=1,
        line={"color": theme.ink, "width": 1.5, "dash": layout.DOTTED},
    )
    return figure.update_layout(
        xaxis={
            "title": {"text": "speedup over the default"},
            # Room for the value after the longest bar.
            "range": [0, max((row.high or row.speedup for row in ranked), default=1.0) * 1.18],
            "ticksuffix": formats.TIMES,
        },
        yaxis={
            "tickmode": "array",
            "tickvals": list(range(len(ranked))),
            "ticktext": [layout.text(row.configuration) for row in ranked],
            "range": [len(ranked) - 0.4, -0.6],
            "showgrid": False,
        },
        margin={"t": 12 if all(row.counts for row in ranked) else 32},
    )


def crowd_bars(place: Ranking, theme: Theme, confirmed: bool = True) -> go.Figure:
    """A bar per device model, largest speedup first; the device of `place` is highlighted.

    If its figure is not `confirmed`, its bar is hollow, and `place` is the place that it would have.
    """
    figure = layout.blank(theme, 300)
    slugs = [device.slug for device, _ in place.models]
    own_colour = theme.best if confirmed else mixed(theme.best, theme.surface, marks.INSIDE)
    lit = [slug == place.device.slug for slug in slugs]
    figure.add_bar(
        x=list(range(1, len(slugs) + 1)),
        y=[round(speedup, 3) for _, speedup in place.models],
        width=0.85,
        marker={
            "color": [own_colour if highlighted else theme.default for highlighted in lit],
            "line": {
                "color": theme.best,
                "width": [1.5 if highlighted and not confirmed else 0 for highlighted in lit],
            },
        },
        # An array is faster: plotly checks nested lists item by item.
        customdata=np.array(
            [
                [
                    layout.lines(
                        [f"<b>{layout.text(device.title)}</b>", f"{formats.speedup(speedup)}, place {number}"]
                    ),
                    reverse("dashboard:device", args=[device.slug]),
                ]
                for number, (device, speedup) in enumerate(place.models, 1)
            ],
            dtype=object,
        ),
        hovertemplate="%{customdata[0]}<extra></extra>",
        # Without x and y, so that no second label of the axis appears.
        hoverinfo="text",
        showlegend=False,
    )
    position = slugs.index(place.device.slug) + 1
    figure.add_annotation(
        x=position,
        y=place.speedup,
        text=f"<b>this device, {formats.speedup(place.speedup)}{'' if confirmed else ', unconfirmed'}</b>",
        font={"color": theme.ink, "size": 13},
        bgcolor=theme.surface,
        showarrow=True,
        arrowcolor=theme.ink,
        arrowhead=0,
        ax=0,
        ay=-28,
        xanchor="left" if position <= len(slugs) / 2 else "right",
    )
    return figure.update_layout(
        xaxis={
            "title": {"text": "device models, largest gain first"},
            "showgrid": False,
            "tickformat": "d",
            "dtick": 1 if len(slugs) <= 12 else None,
        },
        yaxis={
            "title": {"text": "speedup"},
            "range": [0, max(speedup for _, speedup in place.models) * 1.25],
            "ticksuffix": formats.TIMES,
        },
        bargap=0.15,
        hovermode="x",
    )


def releases_height(releases: int) -> int:
    """Pixels that release_marks needs."""
    return 100 + 2 * ROW * max(releases, 1)


def release_marks(releases: Sequence[Release], theme: Theme) -> go.Figure:
    """The speedups by driver and system version, with intervals, in order of first appearance."""
    figure = layout.blank(theme, releases_height(len(releases)))
    figure.add_scatter(
        x=[round(row.speedup, 4) for row in releases],
        y=list(range(len(releases))),
        mode="markers",
        marker={"size": 11, "color": theme.best},
        customdata=[
            layout.lines(
                [
                    f"<b>{formats.speedup(row.speedup)}</b>",
                    layout.count_words(row),
                    f"{formats.day(row.first_at)} to {formats.day(row.last_at)}",
                ]
            )
            for row in releases
        ],
        hovertemplate="%{customdata}<extra></extra>",
        showlegend=False,
    )
    _add_intervals(figure, list(enumerate(releases)), theme)
    names = [", ".join(filter(None, (row.driver, row.os_version))) or "unknown" for row in releases]
    values = [formats.speedup(row.speedup) for row in releases]
    layout.name_bars(figure, zip(values, names, strict=True), theme)
    reach = max((row.high or row.speedup for row in releases), default=1.0)
    return figure.update_layout(
        xaxis={
            "title": {"text": "speedup of best over the default"},
            "range": [0, reach * 1.1],
            "ticksuffix": formats.TIMES,
        },
        yaxis=layout.flat_rows(len(releases)),
        margin={"t": 12},
    )


def drift_steps(steps: Sequence[Step], theme: Theme) -> go.Figure:
    """The slowdown of each run against the first run of its configuration, in order of measurement.

    With more than MOST_COLOURED configurations, only default and best have a colour, and the run with the
    largest change is labelled.
    """
    figure = layout.blank(theme, 320)
    names = list(dict.fromkeys(step.configuration for step in steps))
    colours = layout.configuration_colours(names, theme)
    many = len(names) > MOST_COLOURED
    if many:
        colours = {name: colours[name] if name in (DEFAULT, BEST) else theme.muted for name in names}
    # Default and best are drawn last, on top.
    for name in sorted(names, key=lambda name: many and name in (DEFAULT, BEST)):
        series = [step for step in steps if step.configuration == name]
        lit = not many or name in (DEFAULT, BEST)
        figure.add_scatter(
            x=[step.place for step in series],
            y=layout.rounded([(step.ratio - 1) * 100 for step in series]),
            mode="lines+markers",
            name=layout.text(name),
            line={"color": colours[name], "width": 1.75 if lit else 0.75},
            marker={"size": 9 if lit else 5, "color": colours[name]},
            hovertemplate=f"{layout.text(name)}, run %{{x}}: <b>%{{y:+.1f}} %</b><extra></extra>",
            showlegend=lit,
        )
    if many:
        _name_farthest(figure, steps, theme)
    limit = (MAX_DRIFT - 1) * 100
    figure.add_shape(
        type="line",
        xref="paper",
        x0=0,
        x1=1,
        y0=limit,
        y1=limit,
        line={"color": theme.limit, "width": 1.5, "dash": "dash"},
    )
    highest = max(((step.ratio - 1) * 100 for step in steps), default=0.0)
    lowest = min(((step.ratio - 1) * 100 for step in steps), default=0.0)
    return figure.update_layout(
        xaxis={
            "title": {"text": "run, in the order of measurement"},
            "dtick": 1 if len(steps) <= 12 else None,
        },
        yaxis={
            "title": {"text": "slower than its first run, %"},
            "range": [min(lowest * 1.2, -5.0), max(highest, limit) * 1.15],
            "zeroline": True,
        },
        showlegend=True,
    )


def _name_farthest(figure: go.Figure, steps: Sequence[Step], theme: Theme) -> None:
    """Label the run with the largest change against the first run of its configuration."""
    farthest = max(steps, key=lambda step: abs(step.ratio - 1))
    early = farthest.place <= steps[-1].place / 2
    name = layout.text(layout.clipped(farthest.configuration, 18))
    figure.add_annotation(
        x=farthest.place,
        y=(farthest.ratio - 1) * 100,
        text=f"<b>{formats.change(farthest.ratio)}</b> {name}",
        font={"color": theme.ink, "size": 12},
        xanchor="left" if early else "right",
        yanchor="bottom" if farthest.ratio >= 1 else "top",
        showarrow=False,
    )


def sensors_height(sensors: int) -> int:
    """Pixels that sensor_lines needs."""
    return 70 + SENSOR * max(sensors, 1)


def sensor_lines(sensors: Sequence[Readings], theme: Theme) -> go.Figure:
    """The readings of each sensor, in plots with a common time axis."""
    figure = layout.blank(theme, sensors_height(len(sensors)))
    if not sensors:
        return layout.note(figure, "The device reported no sensors", theme)
    share = 1 / len(sensors)
    for number, sensor in enumerate(sensors):
        axis = "" if number == 0 else str(number + 1)
        figure.add_scatter(
            x=layout.rounded(sensor.seconds),
            y=layout.rounded(sensor.values),
            xaxis="x",
            yaxis=f"y{axis}",
            mode="lines+markers",
            line={"color": theme.series[number], "width": 1.75},
            marker={"size": 4},
            hovertemplate=f"%{{x:.0f}} s: <b>%{{y:.4~r}} {sensor.unit}</b><extra></extra>",
            showlegend=False,
        )
        top = 1 - number * share
        figure.update_layout(
            {
                f"yaxis{axis}": {
                    "domain": [top - share * 0.82, top],
                    "title": {"text": f"{sensor.name},<br>{sensor.unit}"},
                    "nticks": 4,
                    "range": layout.span(sensor.values, LEAST_SPAN.get(sensor.unit, 1.0)),
                }
            }
        )
    last = "" if len(sensors) == 1 else str(len(sensors))
    return figure.update_layout(
        xaxis={"title": {"text": "seconds after the start"}, "anchor": f"y{last}", "rangemode": "tozero"},
        margin={"t": 12},
    )


def _add_intervals(figure: go.Figure, rows: Sequence[tuple[int, Speedup | Release]], theme: Theme) -> None:
    """Add whiskers as a separate trace: plotly draws end caps even for missing intervals."""
    due = [(rank, row.speedup, row.low, row.high) for rank, row in rows if row.low is not None]
    figure.add_scatter(
        x=[round(value, 4) for _, value, _, _ in due],
        y=[rank for rank, *_ in due],
        mode="markers",
        marker={"size": 3, "color": theme.ink},
        error_x={
            "type": "data",
            "symmetric": False,
            "array": [round((high or value) - value, 4) for _, value, _, high in due],
            "arrayminus": [round(value - (low or value), 4) for _, value, low, _ in due],
            "color": theme.ink,
            "thickness": 1.5,
            "width": 4,
        },
        hoverinfo="skip",
        showlegend=False,
    )


def _detail(row: Speedup) -> str:
    value = formats.speedup(row.speedup, row.range)
    parts = [f"<b>{layout.text(row.configuration)}</b>", f"{value} over the default"]
    parts += [*layout.interval_words(row), layout.count_words(row), *layout.state_words(row)]
    return layout.lines(parts)
