"""A figure as a file for a paper's column or a slide: white, with its title above and its source below.

Plotly draws the body; title and source are lines of text around it, so that nothing can overlap. The unit is
the CSS pixel of the figures: a column is as wide as a phone, which every figure is legible on.
"""

import unicodedata
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from plotly import graph_objects as go

from crowd.dashboard.figures.layout import PAGE_TOP
from crowd.dashboard.palette import LIGHT

# Fonts that papers and slides use, and that are there where a file is opened.
FONT = "Helvetica, Arial, 'Liberation Sans', sans-serif"
EDGE = 8  # units between the text and the edge of the picture
# A figure keeps its rows apart at this share of its height on a page.
SHRINK = 0.62
# Vertical pitch of lines of text, in font sizes.
LINE = 1.3
WIDE, NARROW = "MWmw@%\N{EM DASH}", "ijltfrI.,:;|!'()[]/ \N{NO-BREAK SPACE}"


@dataclass(frozen=True)
class Medium:
    """A place for a saved figure. Sizes of fonts are in units; SMALLEST and LARGEST bound those of the body.

    `ratio` is width over height, None where the height follows the figure.
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
    smallest: float = 11.5
    largest: float = 14.5


# 85 mm: a unit is 0.615 pt, so 13 units are 8 pt. A slide is 13.33 inches wide, as PowerPoint's.
COLUMN = Medium("column", 392, 300, None, 85 / 25.4, 300, title=14.5, note=12, source=11.5)
SLIDE = Medium("slide", 720, 250, 16 / 9, 1920 / 144, 144, title=20, note=14, source=12)
MEDIA = {medium.name: medium for medium in (COLUMN, SLIDE)}


@dataclass(frozen=True)
class Line:
    """A line of text; `y` is its baseline, from the top of the picture."""

    text: str
    x: float
    y: float
    size: float
    weight: int
    colour: str


@dataclass(frozen=True)
class Saved:
    """A picture of width x height units: `figure` begins at `top`, `lines` are above and below it."""

    figure: go.Figure
    width: float
    height: float
    top: float
    lines: tuple[Line, ...]
    medium: Medium

    def frame(self) -> dict[str, Any]:
        """What a browser needs besides the figure."""
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


def saved(figure: go.Figure, medium: Medium, title: str, note: str, source: Sequence[str]) -> Saved:
    """FIGURE, which is drawn in the light theme, for MEDIUM: TITLE and NOTE above it, the parts of SOURCE
    below it, its legend between axis and source.
    """
    needed = max(min(figure.layout.height, medium.body), round(SHRINK * figure.layout.height))
    above = [
        *_lines([title], medium, medium.title, 700, LIGHT.ink),
        *_lines([note], medium, medium.note, 400, LIGHT.muted),
    ]
    below = _lines(source, medium, medium.source, 400, LIGHT.muted)
    top, bottom = EDGE + _height(above) + EDGE, EDGE + _height(below) + EDGE
    if medium.ratio is None:
        scale, height = 1.0, top + needed + bottom
    else:
        # Where the figure needs more room than a slide has, the slide grows in units: all becomes smaller.
        height = medium.width / medium.ratio
        scale = max(1.0, needed / (height - top - bottom))
        height *= scale
        top, bottom = top * scale, bottom * scale
    width = medium.width * scale
    lines = [
        *_placed(above, EDGE * scale, scale),
        *_placed(below, height - bottom + EDGE * scale, scale),
    ]
    body = _body(figure, medium, width, height - top - bottom)
    return Saved(body, width, height, top, tuple(lines), medium)


def _body(figure: go.Figure, medium: Medium, width: float, height: float) -> go.Figure:
    """FIGURE alone at WIDTH x HEIGHT units, its legend at the bottom."""
    layout = _fitted(figure.layout.to_plotly_json(), medium)
    for name, axis in layout.items():
        room = height - 110 if name.startswith("yaxis") else width - 70
        if name.startswith(("xaxis", "yaxis")) and axis.get("title", {}).get("text"):
            domain = axis.get("domain", (0, 1))
            share = domain[1] - domain[0] if name.startswith("yaxis") else 1.0
            size = axis["title"].get("font", {}).get("size", 13)
            axis["title"]["text"] = "<br>".join(wrapped(axis["title"]["text"], size, room * share))
    layout["font"] = {**layout.get("font", {}), "family": FONT}
    layout["paper_bgcolor"] = layout["plot_bgcolor"] = LIGHT.surface
    layout |= {"width": round(width), "height": round(height)}
    layout["margin"] = {**layout["margin"], "t": _top(layout)}
    # A legend that hangs on the container makes room for itself below the axis, whatever its height.
    place = {"x": EDGE / width, "xanchor": "left", "xref": "container", "y": 0, "yanchor": "bottom"}
    layout["legend"] = {
        **layout["legend"],
        **place,
        "yref": "container",
        "orientation": "h",
        "entrywidth": None,
    }
    return go.Figure(figure.data, layout)


def _top(layout: dict[str, Any]) -> float:
    """Room above the plot: what the figure asks for, without that for a legend."""
    if layout["margin"]["t"] > PAGE_TOP:
        return float(layout["margin"]["t"])
    above = [words for words in layout.get("annotations", ()) if words.get("y") == 1]
    return 24 if above else EDGE


def _fitted(part: Any, medium: Medium) -> Any:
    """PART of a layout with the sizes of its fonts within those of MEDIUM."""
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
    """PARTS in lines of MEDIUM's width, not yet placed."""
    room: float = medium.width - 2 * EDGE
    # Letters of a bold font are wider.
    room /= 1.08 if weight > 400 else 1.0
    return [
        Line(text, EDGE, 0.0, size, weight, colour)
        for text in wrapped(" \N{MIDDLE DOT} ".join(filter(None, parts)), size, room)
    ]


def _height(lines: Sequence[Line]) -> float:
    return sum(LINE * line.size for line in lines)


def _placed(lines: Sequence[Line], top: float, scale: float) -> list[Line]:
    """LINES one below the other from TOP, everything SCALE times as large."""
    placed = []
    for line in lines:
        top += LINE * line.size * scale
        # A quarter of a font is below its baseline.
        baseline = top - 0.3 * line.size * scale
        placed.append(replace(line, x=line.x * scale, y=round(baseline, 2), size=round(line.size * scale, 2)))
    return placed


def wrapped(text: str, size: float, room: float) -> list[str]:
    """TEXT in lines no wider than ROOM at a font SIZE; a word that is wider, such as an address, is cut."""
    lines: list[str] = []
    for word in text.split(" "):
        joined = f"{lines[-1]} {word}" if lines else word
        if text_width(joined, size) <= room:
            lines[-1:] = [joined]
            continue
        if lines and text_width(word, size) > room:
            # What fits goes behind the words before it.
            head, word = _cut(word, size, room - text_width(lines[-1] + " ", size))
            lines[-1] = f"{lines[-1]} {head}".rstrip()
        while text_width(word, size) > room:
            head, word = _cut(word, size, room)
            lines.append(head)
        lines.append(word)
    return lines


def _cut(word: str, size: float, room: float) -> tuple[str, str]:
    """WORD in two parts of which the first fits into ROOM: behind a separator where there is one."""
    fits = max((length for length in range(len(word)) if text_width(word[:length], size) <= room), default=0)
    at = max(word.rfind(sign, 0, fits) for sign in "/?&=-,")
    at = at + 1 if at > fits // 3 else fits
    return word[:at], word[at:]


def text_width(text: str, size: float) -> float:
    """Units that TEXT takes at most in FONT at SIZE."""
    return size * sum(_letter_width(letter) for letter in text)


def _letter_width(letter: str) -> float:
    """Width of LETTER in font sizes, rounded up from Helvetica's."""
    if unicodedata.east_asian_width(letter) in "WF":
        return 1.0
    if letter in WIDE:
        return 1.0
    if letter in NARROW:
        return 0.34
    return 0.72 if letter.isupper() else 0.56
