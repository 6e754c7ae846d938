"""Reports drawn side by side: time of each stage, time and trajectory error of each frame."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from slam.reports.page import escape, plotly
from slam.reports.report import milliseconds, stages
from slam.system import STAGES
from wire.protocol import VALID_BELOW

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

# Okabe and Ito's colours, which colour-blind readers can tell apart.
STAGE_COLOURS = dict(zip(STAGES, ("#56B4E9", "#E69F00", "#009E73", "#CC79A7"), strict=True))
# Names are long: each has a line of its own below the figure.
LEGEND = {"showlegend": True, "legend": {"orientation": "v", "x": 0, "y": -0.2, "yanchor": "top"}}
# Colour, symbol, and which frames of a report are meant.
FRAME_KINDS: Mapping[str, tuple[str, str, Callable[[Mapping[str, Any]], bool]]] = {
    "integrated": ("#009E73", "line-ns-open", lambda frame: bool(frame["integrated"])),
    "skipped": ("#0072B2", "line-ns-open", lambda frame: bool(frame["skipped"])),
    "lost": ("#D55E00", "x", lambda frame: frame["tracked"] is False),
}
LINE_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")


def figures(reports: Mapping[str, Mapping[str, Any]]) -> list[Figure]:
    """Figures of reports by name: stages, computation and fate of each frame, the error where one is known.

    Reports of older versions lack the error of each frame and have no line in the last figure.
    Raises MissingPlotlyError.
    """
    drawn = [_stages(reports), _computation(reports), _frames(reports)]
    if any(_errors(report) for report in reports.values()):
        drawn.append(_error(reports))
    return drawn


def _stages(reports: Mapping[str, Mapping[str, Any]]) -> Figure:
    figure = plotly().Figure()
    names = [escape(name) for name in reports]
    for stage in STAGES:
        times = [
            milliseconds(report, stage).mean() if stage in stages(report) else None
            for report in reports.values()
        ]
        figure.add_bar(
            y=names, x=times, name=stage, orientation="h", marker_color=STAGE_COLOURS[stage],
            hovertemplate=f"{stage} %{{x:.3f}} ms<extra>%{{y}}</extra>",
        )  # fmt: skip
    devices = sorted({report["device"]["name"] for report in reports.values()})
    sequences = sorted({report["sequence"]["name"] for report in reports.values()})
    systems = sorted({report["system"] for report in reports.values()})
    figure.update_layout(
        barmode="stack",
        title=escape(
            f"Time per stage of {' and '.join(systems)} on {', '.join(sequences)}, {', '.join(devices)}"
        ),
        xaxis_title="mean wall milliseconds a frame",
        yaxis={"autorange": "reversed", "automargin": True},
        height=200 + 50 * len(names),
        template="plotly_white",
    )
    return figure


def _computation(reports: Mapping[str, Mapping[str, Any]]) -> Figure:
    figure = plotly().Figure()
    for number, (name, report) in enumerate(reports.items()):
        times = [1e3 * frame["computation"] for frame in report["frames"]]
        figure.add_scatter(
            x=list(range(len(times))), y=times, name=escape(name), mode="lines",
            line_color=LINE_COLOURS[number % len(LINE_COLOURS)],
        )  # fmt: skip
    figure.update_layout(
        title="Computation of each frame",
        xaxis_title="frame",
        yaxis={"title": "wall milliseconds", "rangemode": "tozero"},
        **LEGEND,
        template="plotly_white",
    )
    return figure


def _frames(reports: Mapping[str, Mapping[str, Any]]) -> Figure:
    """A mark for each frame that was integrated, skipped or lost; a row for each kind and report."""
    figure = plotly().Figure()
    for name, report in reports.items():
        for kind, (colour, symbol, holds) in FRAME_KINDS.items():
            numbers: list[int | None] = [
                number for number, frame in enumerate(report["frames"]) if holds(frame)
            ]
            label = f"{name}: {kind} ({len(numbers)})"
            figure.add_scatter(
                x=numbers or [None], y=[escape(label)] * max(len(numbers), 1), name=escape(label),
                mode="markers", marker={"color": colour, "symbol": symbol, "size": 7},
                hovertemplate=f"frame %{{x}} {kind}<extra></extra>",
            )  # fmt: skip
    figure.update_layout(
        title="Integrated, skipped and lost frames",
        xaxis={"title": "frame", "range": [-1, max(len(report["frames"]) for report in reports.values())]},
        yaxis={"autorange": "reversed", "automargin": True},
        showlegend=False,
        height=200 + 70 * len(reports),
        template="plotly_white",
    )
    return figure


def _error(reports: Mapping[str, Mapping[str, Any]]) -> Figure:
    figure = plotly().Figure()
    for number, (name, report) in enumerate(reports.items()):
        colour = LINE_COLOURS[number % len(LINE_COLOURS)]
        errors = _errors(report)
        if not errors:
            continue
        title = f"{name} (max {report['ate']['max']:.4f} m)"
        figure.add_scatter(
            x=list(range(len(errors))), y=errors, name=escape(title), mode="lines", line_color=colour
        )
        lost = [index for index, frame in enumerate(report["frames"]) if frame["tracked"] is False]
        if lost:
            figure.add_scatter(
                x=lost, y=[errors[index] for index in lost], name=escape(f"{name}: lost"), mode="markers",
                marker={"color": colour, "symbol": "x", "size": 7},
            )  # fmt: skip
    figure.add_hline(y=VALID_BELOW, line_dash="dot", line_color="#888888", annotation_text="valid below")
    figure.update_layout(
        title="Trajectory error of each frame (first poses laid on each other)",
        xaxis_title="frame",
        yaxis={"title": "metres from the truth", "rangemode": "tozero"},
        **LEGEND,
        template="plotly_white",
    )
    return figure


def _errors(report: Mapping[str, Any]) -> list[float | None]:
    """Metres of each frame, None where unknown; empty where none is known."""
    errors = [frame.get("error") for frame in report["frames"]]
    return errors if any(error is not None for error in errors) else []
