"""Placement of the names of points, so that they do not overlap at any size of the figure.

A figure is computed once, then stretched to the width of the page, and made lower when it is saved. Names are
placed around their points, the most important first, and checked at the smallest and the largest width and
height. Gaps change linearly in between, so names stay apart at every size. A name that would cover points
stands further away from its own one, with a line to it.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import islice, pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from plotly import graph_objects as go

from crowd.dashboard import formats
from crowd.dashboard.figures.elements import layout
from crowd.dashboard.figures.palette import Theme
from wire.front import BEST, DEFAULT

SIZE = 13  # of the font, pixels
LETTER, LINE = 7.6, 18.0  # pixels that a letter and a line take at most
GAP = 10.0  # pixels from the middle of a point to its name
STEP = 0.015  # of the plane, between two spots of a line
NEAR = 0.75  # of the width
MARK = 8.0  # pixels from the middle of a point to its edge
LEADERS = (24.0, 36.0, 50.0, 68.0, 92.0, 124.0, 165.0)  # pixels, the lengths of lines from points to names
TURNS = [turn * math.pi / 8 for turn in range(16)]  # of these lines
ROOM = 1.18  # beyond the outermost points, as a factor
LEAST_SPAN = 3.0  # of an axis, as a factor
LOW = 165.0  # pixels, the least height of a plane: of a figure for a column
WIDTHS = (205.0, 1270.0)  # of the plane, on the narrowest phone and on the widest page
FEW = 8  # names, with which numbered ones are written too
CHECKED_WIDTHS = (205.0, 300.0, 450.0, 680.0, 950.0, 1270.0)  # at which names should cover no points


@dataclass(frozen=True)
class Spot:
    """A point with a name, at `across` and `up` (0 to 1) of the plane.

    `gap`: pixels between its centre and the name.
    """

    name: str
    across: float
    up: float
    gap: float = GAP


@dataclass(frozen=True)
class Plane:
    """The ranges of the logarithmic axes of a plane, and its height in pixels."""

    across: tuple[float, float]
    up: tuple[float, float]
    height: float

    @classmethod
    def around(cls, xs: Sequence[float], ys: Sequence[float], height: float) -> "Plane":
        """A plane of `height` pixels around all of `xs` and `ys`."""
        return cls(_around(xs), _around(ys), height)

    def spot(self, name: str, x: float, y: float, gap: float = GAP) -> Spot:
        """The point `name` at (X, Y)."""
        return Spot(name, _share(x, self.across), _share(y, self.up), gap)

    def line(self, corners: Sequence[tuple[float, float]]) -> list[Spot]:
        """Spots along the line through `corners`, so that names avoid it."""
        spots = [self.spot("", x, y) for x, y in corners]
        between = []
        for start, end in pairwise(spots):
            steps = math.ceil(max(abs(end.across - start.across), abs(end.up - start.up)) / STEP)
            for step in range(1, steps):
                part = step / steps
                across = start.across + part * (end.across - start.across)
                between.append(Spot("", across, start.up + part * (end.up - start.up)))
        return between

    def anchor(self, x: float) -> str:
        """The anchor of a text above X: near the right edge, the text ends there."""
        return "right" if _share(x, self.across) > NEAR else "center"

    @property
    def ranges(self) -> tuple[list[float], list[float]]:
        """The ranges of both axes as exponents, as plotly needs them."""
        return [math.log10(end) for end in self.across], [math.log10(end) for end in self.up]


class Side(NamedTuple):
    """The position of a name at its point: text anchors, and the shift in pixels (right, up).

    `leader`: with a line to the point.
    """

    xanchor: str
    yanchor: str
    xshift: float
    yshift: float
    leader: bool = False

    def members(self, colour: str) -> dict[str, Any]:
        """The members of plotly's annotation; a leader has `colour`."""
        anchors = {"xanchor": self.xanchor, "yanchor": self.yanchor, "showarrow": self.leader}
        if not self.leader:
            return anchors | {"xshift": self.xshift, "yshift": self.yshift}
        line = {"arrowcolor": colour, "arrowhead": 0, "arrowwidth": 1, "standoff": MARK}
        return anchors | line | {"ax": round(self.xshift, 1), "ay": -round(self.yshift, 1)}


Ends = tuple[float, float]


class _Box(NamedTuple):
    """A box in pixels: left and right at the smallest and largest width, bottom and top at such heights."""

    left: Ends
    right: Ends
    bottom: Ends
    top: Ends

    def apart(self, other: "_Box") -> bool:
        """Whether the boxes do not touch at any size."""
        return (
            _beyond(other.left, self.right)
            or _beyond(self.left, other.right)
            or _beyond(other.bottom, self.top)
            or _beyond(self.bottom, other.top)
        )


class _Choice(NamedTuple):
    """A side for a name. `cost`: how many points and how much of lines it covers, and its rank."""

    cost: tuple[int, int, int]
    name: str
    side: Side
    box: _Box


@lru_cache
def _sides(gap: float) -> tuple[Side, ...]:
    """The possible positions of a name `gap` pixels from the centre of its point, preferred ones first."""
    near = gap * 0.8
    sides = [
        Side("left", "middle", gap, 0),
        Side("right", "middle", -gap, 0),
        Side("center", "bottom", 0, gap),
        Side("center", "top", 0, -gap),
        Side("left", "bottom", near, near),
        Side("right", "top", -near, -near),
        Side("right", "bottom", -near, near),
        Side("left", "top", near, -near),
    ]
    far = gap + 0.7 * LINE
    for horizontal, shift in (("center", 0.0), ("left", near), ("right", -near)):
        sides += [Side(horizontal, "bottom", shift, far), Side(horizontal, "top", shift, -far)]
    sides += [_leader(length, math.cos(turn), math.sin(turn)) for length in LEADERS for turn in TURNS]
    return tuple(sides)


def _leader(length: float, right: float, up: float) -> Side:
    horizontal = "left" if right > 0.5 else "right" if right < -0.5 else "center"
    vertical = "bottom" if up > 0.5 else "top" if up < -0.5 else "middle"
    return Side(horizontal, vertical, length * right, length * up, leader=True)


def labelled_names(names: Iterable[str], chosen: str = "") -> list[str]:
    """The `names` to write beside their points, most important first.

    Default, best and `chosen`, then other proper names. Numbered points of more than FEW are only named on
    hover.
    """
    names = list(dict.fromkeys(names))
    first = [name for name in (DEFAULT, BEST, chosen) if name in names]
    proper = [name for name in names if not formats.is_numbered(name)]
    return list(dict.fromkeys([*first, *proper, *(names if len(names) <= FEW else ())]))


def place(
    names: Sequence[Spot], points: Iterable[Spot], height: float, lines: Iterable[Spot] = ()
) -> dict[str, Side]:
    """A position for each of `names`, most important first; names without room get none.

    Names cover as few of `points` as possible; then they and their leaders cross as little as possible. Each
    is tried as the first one, because one with a single free side may lose it to another with several.
    `height` of the plane is in pixels.
    """
    marks, spots = (
        np.array([(spot.across, spot.up) for spot in each]).reshape(-1, 2) for each in (points, lines)
    )
    choices = []
    for spot in names:
        sides = enumerate(_sides(spot.gap))
        boxes = [(number, side, _box(spot, side, height)) for number, side in sides]
        inside = [
            _Choice((*_cost(spot, side, marks, spots, height), number), spot.name, side, box)
            for number, side, box in boxes
            if _inside(box, height)
        ]
        choices.append(sorted(inside, key=lambda choice: choice.cost))
    orders = [[first, *(other for other in choices if other is not first)] for first in choices]
    placed = [_greedy(order) for order in orders]
    return min(placed, key=lambda one: one[0], default=((), {}))[1]


def _greedy(choices: Sequence[Sequence[_Choice]]) -> tuple[tuple[int, ...], dict[str, Side]]:
    """The first of each of `choices` that is apart from those before, and what all of them cost."""
    taken: list[_Choice] = []
    for ranked in choices:
        free = (choice for choice in ranked if all(choice.box.apart(other.box) for other in taken))
        taken.extend(islice(free, 1))
    costs = zip(*(choice.cost for choice in taken), strict=True)
    return (-len(taken), *map(sum, costs)), {choice.name: choice.side for choice in taken}


def add(
    figure: go.Figure,
    plane: Plane,
    names: Sequence[Spot],
    points: Iterable[Spot],
    theme: Theme,
    lines: Iterable[Spot] = (),
) -> None:
    """Write `names` beside their points in `figure`, which has the axes of `plane`, apart from `lines`."""
    sides = place(names, points, plane.height, lines)
    spots = {spot.name: spot for spot in names}
    written: list[Mapping[str, Any]] = [
        {
            # Relative to the plane: on a logarithmic axis, plotly uses exponents.
            "xref": "x domain",
            "yref": "y domain",
            "x": round(spots[name].across, 4),
            "y": round(spots[name].up, 4),
            "text": layout.text(name),
            "font": {"color": theme.ink, "size": SIZE},
            # Covers a line that the name cannot avoid.
            "bgcolor": theme.surface,
            "opacity": 0.9,
            "borderpad": 0,
            **side.members(theme.muted),
        }
        for name, side in sides.items()
    ]
    figure.update_layout(annotations=[*figure.layout.annotations, *written])


def _around(values: Sequence[float]) -> tuple[float, float]:
    low, high = (min(values), max(values)) if values else (1.0, 1.0)
    # A minimum span, so that nearly equal values do not show only noise.
    room = max(ROOM, (LEAST_SPAN * low / high) ** 0.5)
    return low / room, high * room


def _share(value: float, ends: tuple[float, float]) -> float:
    low, high = (math.log(end) for end in ends)
    return (math.log(value) - low) / (high - low)


def _beyond(edges: Ends, others: Ends) -> bool:
    """Whether `edges` are beyond `others` at both sizes."""
    return edges[0] >= others[0] and edges[1] >= others[1]


def extent(name: str, side: Side) -> tuple[Ends, Ends]:
    """The pixels from a point to the ends of its name: left and right, bottom and top."""
    wide = LETTER * len(name)
    start = side.xshift - {"left": 0.0, "center": 0.5, "right": 1.0}[side.xanchor] * wide
    below = side.yshift - {"bottom": 0.0, "middle": 0.5, "top": 1.0}[side.yanchor] * LINE
    return (start, start + wide), (below, below + LINE)


def _cost(
    spot: Spot, side: Side, points: NDArray[np.float64], lines: NDArray[np.float64], height: float
) -> tuple[int, int]:
    """How many `points` the name covers; and how much it or its leader covers besides.

    These are `lines`, what the leader crosses, and points in a figure of the least height. `points` and
    `lines` are (n, 2), in shares of the plane. All is counted at each of CHECKED_WIDTHS.
    """
    crossed = sum(_crossed(spot, side, marks, height) for marks in (points, lines)) if side.leader else 0
    besides = _covered(spot, side, lines, height) + _covered(spot, side, points, LOW)
    return _covered(spot, side, points, height), besides + crossed


def _covered(spot: Spot, side: Side, marks: NDArray[np.float64], height: float) -> int:
    (left, right), (bottom, top) = extent(spot.name, side)
    across, up = _pixels(spot, marks, height)
    inside = (up > bottom - MARK) & (up < top + MARK)
    return int(np.count_nonzero((across > left - MARK) & (across < right + MARK) & inside))


def _crossed(spot: Spot, side: Side, marks: NDArray[np.float64], height: float) -> int:
    across, up = _pixels(spot, marks, height)
    length = math.hypot(side.xshift, side.yshift)
    along = (across * side.xshift + up * side.yshift) / length
    beside = abs(across * side.yshift - up * side.xshift) / length
    return int(np.count_nonzero((along > 2 * MARK) & (along < length) & (beside < MARK / 2)))


def _pixels(
    spot: Spot, marks: NDArray[np.float64], height: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The pixels from `spot` to `marks`: to the right (widths, n) and up (n,)."""
    across = np.multiply.outer(np.array(CHECKED_WIDTHS), marks[:, 0] - spot.across)
    return across, (marks[:, 1] - spot.up) * height


def _box(spot: Spot, side: Side, height: float) -> _Box:
    across, up = extent(spot.name, side)
    xs, ys = [spot.across * width for width in WIDTHS], [spot.up * one for one in (LOW, height)]
    return _Box(
        left=(xs[0] + across[0], xs[1] + across[0]),
        right=(xs[0] + across[1], xs[1] + across[1]),
        bottom=(ys[0] + up[0], ys[1] + up[0]),
        top=(ys[0] + up[1], ys[1] + up[1]),
    )


def _inside(box: _Box, height: float) -> bool:
    within = _beyond(WIDTHS, box.right) and _beyond((LOW, height), box.top)
    return within and _beyond(box.left, (0.0, 0.0)) and _beyond(box.bottom, (0.0, 0.0))
