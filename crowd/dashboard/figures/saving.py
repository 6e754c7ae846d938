"""Figures as files for a column of a paper or a slide, with the title above and the source below.

Plotly draws the body. Title and source are lines of text around it, so that nothing overlaps. The unit is the
CSS pixel: a column is as wide as a phone, on which every figure is legible.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from plotly import graph_objects as go

from crowd.dashboard.figures.elements.layout import ROW_NAME
from crowd.dashboard.figures.elements.wrapping import wrapped
from crowd.dashboard.figures.palette import LIGHT

# Fonts that are common in papers and slides, and installed on most systems.
FONT = "Helvetica, Arial, 'Liberation Sans', sans-serif"
EDGE = 8  # units between the text and the edge of the picture
# Vertical pitch of lines of text, in font sizes.
LINE = 1.3
NARROW = 560  # units, as in figures.js
WORDS_ABOVE = 24  # units, for words above an upright line
AXIS_FONT = 13
MOST_SHRUNK = 1.5  # times, on a slide
AROUND_ROWS = 90  # units, for what is above and below the rows of a plot


@dataclass(frozen=True)
class Medium:
    """A target of saved figures. Sizes are in units; `smallest` and `largest` bound the fonts of the body.

    `body`: minimum height of the body. `shrink`: the share of its height on a page at which a figure still
    keeps its rows apart. `ratio`: width over height, None if the height follows from the figure.
    """

    name: str
    width: int
    body: int
    ratio: float | None
    inches: float
    dpi: int
    title: float
    note: float
    source: float
    shrink: float
    names_beside: bool
    smallest: float = 11.5
    largest: float = 14.5


# 85 mm: a unit is 0.615 pt, so 13 units are 8 pt. A slide is 13.33 inches wide, as in PowerPoint.
COLUMN = Medium(
    "column", 392, 300, None, 85 / 25.4, 300,
    title=14.5, note=12, source=11.5, shrink=0.68, names_beside=False,
)  # fmt: skip
SLIDE = Medium(
    "slide", 720, 250, 16 / 9, 1920 / 144, 144,
    title=20, note=14, source=12, shrink=0.4, names_beside=True,
)  # fmt: skip
MEDIA = {medium.name: medium for medium in (COLUMN, SLIDE)}


@dataclass(frozen=True)
class Line:
    """A line of text; `y` is its baseline, measured from the top of the picture."""

    text: str
    x: float
    y: float
    size: float
    weight: int
    colour: str


@dataclass(frozen=True)
class SavedFigure:
    """A picture of width x height units. `figure` starts at `top`; `lines` are above and below it."""

    figure: go.Figure
    width: float
    height: float
    top: float
    lines: tuple[Line, ...]
    medium: Medium

    def frame(self) -> dict[str, Any]:
        """The data that a browser needs in addition to the figure."""
        inches = self.medium.inches
        return {
            "width": self.width,
            "height": self.height,
            "top": self.top,
            "lines": [asdict(line) for line in self.lines],
            "font": FONT,
            "background": LIGHT.surface,
            "millimetres": [round(25.4 * inches, 2), round(25.4 * inches * self.height / self.width, 2)],
            "pixels": [
                round(inches * self.medium.dpi),
                round(inches * self.medium.dpi * self.height / self.width),
            ],
            "dpi": self.medium.dpi,
        }


def render_for(
    figure: go.Figure, medium: Medium, title: str, note: str, source: Sequence[str]
) -> SavedFigure:
    """Lay out `figure` (in the light theme) for `medium`.

    `title` and `note` are above it, the parts of `source` below it, and its legend between axis and source.
    """
    needed = _needed(figure, medium)
    above = [
        *_lines([title], medium, medium.title, 700, LIGHT.ink),
        *_lines([note], medium, medium.note, 400, LIGHT.muted),
    ]
    below = _lines(source, medium, medium.source, 400, LIGHT.muted)
    top, bottom = EDGE + _height(above) + EDGE, EDGE + _height(below) + EDGE
    if medium.ratio is None:
        scale, height = 1.0, top + needed + bottom
    else:
        # If the figure needs more room than a slide has, the slide gets more units: everything becomes
        # smaller. With so many rows that it would be unreadable, it becomes taller instead.
        height = medium.width / medium.ratio
        scale = min(max(1.0, needed / (height - top - bottom)), MOST_SHRUNK)
        top, bottom = top * scale, bottom * scale
        height = max(height * scale, top + needed + bottom)
    width = medium.width * scale
    lines = [
        *_placed(above, EDGE * scale, scale),
        *_placed(below, height - bottom + EDGE * scale, scale),
    ]
    body = _body(figure, medium, width, height - top - bottom)
    return SavedFigure(body, width, height, top, tuple(lines), medium)


def _needed(figure: go.Figure, medium: Medium) -> float:
    """The minimum height of the body in units at which rows and their names stay apart."""
    height: float = figure.layout.height
    axis = figure.layout.yaxis
    # A logarithmic axis has ticks far beyond what it shows.
    rows = 0 if axis.type == "log" else len(axis.tickvals or ())
    least = medium.shrink * height
    if medium.names_beside and (beside := len(_row_names(figure.layout.to_plotly_json()))):
        rows, least = beside, 0.0
    return max(min(height, medium.body), least, rows * AXIS_FONT * LINE + AROUND_ROWS)


def _row_names(layout: dict[str, Any]) -> list[dict[str, Any]]:
    """The annotations that name horizontal bars."""
    return [words for words in layout.get("annotations", ()) if words.get("name") == ROW_NAME]


def _body(figure: go.Figure, medium: Medium, width: float, height: float) -> go.Figure:
    """`figure` without text, at `width` x `height` units, with its legend at the bottom."""
    layout = figure.layout.to_plotly_json()
    _adapt_to_width(layout, width, medium.names_beside)
    layout = _fitted(layout, medium)
    if medium.names_beside:
        _put_names_beside(layout)
    _wrap_axis_titles(layout, width, height)
    for axis in layout["template"]["layout"].values():
        # The first labels of both axes meet at their corner.
        axis["ticklabelstandoff"] = 4
    _keep_words_inside(layout)
    layout["font"] = {**layout["font"], "family": FONT}
    layout["paper_bgcolor"] = layout["plot_bgcolor"] = LIGHT.surface
    layout |= {"width": round(width), "height": round(height)}
    # Plotly adds room for a colour scale, and for the legend at its new place.
    layout["margin"] = {**layout["margin"], "t": WORDS_ABOVE if _above(layout) else EDGE}
    legend = {"x": EDGE / width, "xanchor": "left", "xref": "container", "y": 0, "yanchor": "bottom"}
    layout["legend"] |= {**legend, "yref": "container", "orientation": "h", "entrywidth": None}
    traces = [_fitted(trace.to_plotly_json(), medium) for trace in figure.data]
    for trace in traces:
        if trace["type"] == "bar":
            # Plotly would shrink a value that has no room beside its bar.
            trace["constraintext"] = "none"
    return go.Figure(traces, layout)


def _adapt_to_width(layout: dict[str, Any], width: float, names_beside: bool) -> None:
    """Apply the changes that figures.js makes on narrow pages; names beside bars are always short."""
    changes = (layout.pop("meta", None) or {}).get("narrow", {})
    for path, value in changes.items():
        if width >= NARROW and not (names_beside and _row_names(layout) and path == "annotations"):
            continue
        *parents, last = path.split(".")
        part = layout
        for name in parents:
            part = part.setdefault(name, {})
        part[last] = value


def _put_names_beside(layout: dict[str, Any]) -> None:
    """Move the names of horizontal bars beside them, which needs half the height."""
    names = _row_names(layout)
    if not names:
        return
    layout["annotations"] = [words for words in layout["annotations"] if words not in names]
    layout["yaxis"] = layout["yaxis"] | {
        "visible": True,
        "showgrid": False,
        "zeroline": False,
        "tickvals": list(range(len(names))),
        "ticktext": [words["text"] for words in names],
        "tickfont": names[0]["font"],
    }


def _wrap_axis_titles(layout: dict[str, Any], width: float, height: float) -> None:
    """Break titles that are longer than their axis."""
    for name, axis in layout.items():
        if not name.startswith(("xaxis", "yaxis")) or not axis.get("title", {}).get("text"):
            continue
        start, end = axis.get("domain", (0, 1))
        # The other axis, its title and the legend need room too.
        room = (height - 110 if name.startswith("yaxis") else width - 70) * (end - start)
        axis["title"]["text"] = "<br>".join(wrapped(axis["title"]["text"], AXIS_FONT, room, cut=False))


def _keep_words_inside(layout: dict[str, Any]) -> None:
    """Let words above a line end at the line, if it is near the right edge."""
    low, high = layout.get("xaxis", {}).get("range") or (0, 0)
    for words in _above(layout):
        if words.get("xref", "x") == "x" and low < high and words["x"] > low + 0.7 * (high - low):
            words["xanchor"] = "right"


def _above(layout: dict[str, Any]) -> list[dict[str, Any]]:
    """The annotations above the plot."""
    return [
        words
        for words in layout.get("annotations", ())
        if words.get("yref") == "paper" and words.get("y", 0) >= 1 and words.get("yanchor") == "bottom"
    ]


def _fitted(part: Any, medium: Medium) -> Any:
    """`part` of a layout with font sizes limited to those of `medium`."""
    if isinstance(part, dict):
        return {
            name: _font(value, medium) if name.endswith("font") else _fitted(value, medium)
            for name, value in part.items()
        }
    return [_fitted(value, medium) for value in part] if isinstance(part, list | tuple) else part


def _font(font: dict[str, Any], medium: Medium) -> dict[str, Any]:
    if "size" not in font:
        return font
    return {**font, "size": min(max(font["size"], medium.smallest), medium.largest)}


def _lines(parts: Sequence[str], medium: Medium, size: float, weight: int, colour: str) -> list[Line]:
    """`parts` broken into lines of `medium`'s width, without vertical positions."""
    room: float = medium.width - 2 * EDGE
    # Bold letters are wider.
    room /= 1.08 if weight > 400 else 1.0
    return [
        Line(text, EDGE, 0.0, size, weight, colour)
        for text in wrapped("\N{NO-BREAK SPACE}\N{MIDDLE DOT} ".join(filter(None, parts)), size, room)
    ]


def _height(lines: Sequence[Line]) -> float:
    return sum(LINE * line.size for line in lines)


def _placed(lines: Sequence[Line], top: float, scale: float) -> list[Line]:
    """`lines` below each other from `top`, scaled by `scale`."""
    placed = []
    for line in lines:
        top += LINE * line.size * scale
        # About a quarter of the font size is below the baseline.
        baseline = top - 0.3 * line.size * scale
        placed.append(replace(line, x=line.x * scale, y=round(baseline, 2), size=round(line.size * scale, 2)))
    return placed
