"""The diagrams of the guide, as small SVG files: boxes on a grid and arrows between them."""

from dataclasses import dataclass
from html import escape
from itertools import pairwise
from pathlib import Path

PICTURES = Path(__file__).resolve().parents[1] / "pictures"
FONT = "system-ui, sans-serif"
LINE, CHARACTER, MARGIN, GAP_X, GAP_Y = 17, 6.6, 16, 46, 40


@dataclass(frozen=True)
class Box:
    """A box at a place of the grid: a bold title, and lines below it."""

    name: str
    column: int
    row: int
    title: str
    lines: tuple[str, ...] = ()
    accent: bool = False

    @property
    def width(self) -> float:
        return (
            max(CHARACTER * 1.1 * len(self.title), *(CHARACTER * len(line) for line in ("", *self.lines)))
            + 24
        )

    @property
    def height(self) -> float:
        return LINE * (1 + len(self.lines)) + 18


def diagram(boxes: list[Box], arrows: list[tuple[str, str, str]]) -> str:
    """An SVG of `boxes`, with `arrows` as (from, to, label) between boxes of one row or one column."""
    columns = sorted({box.column for box in boxes})
    rows = sorted({box.row for box in boxes})
    widths = {c: max(box.width for box in boxes if box.column == c) for c in columns}
    heights = {r: max(box.height for box in boxes if box.row == r) for r in rows}
    labels = max((CHARACTER * len(label) for *_, label in arrows), default=0)
    gap = max(GAP_X, labels + 20)
    left = {c: MARGIN + sum(widths[d] + gap for d in columns if d < c) for c in columns}
    top = {r: MARGIN + sum(heights[d] + GAP_Y for d in rows if d < r) for r in rows}
    width = MARGIN * 2 + sum(widths.values()) + gap * (len(columns) - 1)
    height = MARGIN * 2 + sum(heights.values()) + GAP_Y * (len(rows) - 1)
    places = {
        box.name: (left[box.column], top[box.row], widths[box.column], heights[box.row]) for box in boxes
    }
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}" '
        f'width="{width:.0f}" height="{height:.0f}" font-family="{FONT}" font-size="12">',
        '<defs><marker id="arrow" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" '
        'orient="auto-start-reverse"><path d="M0 0 8 4 0 8z" fill="#51616b"/></marker></defs>',
        f'<rect width="{width:.0f}" height="{height:.0f}" rx="8" fill="#ffffff"/>',
    ]
    parts += [_arrow(places[start], places[end], label) for start, end, label in arrows]
    parts += [_box(box, places[box.name]) for box in boxes]
    return "\n".join([*parts, "</svg>", ""])


def _box(box: Box, place: tuple[float, float, float, float]) -> str:
    x, y, width, height = place
    middle = x + width / 2
    first = y + (height - LINE * (1 + len(box.lines))) / 2 + 13
    fill, stroke = ("#fdf0e8", "#b3470c") if box.accent else ("#f4f6f5", "#8b989f")
    text = [f'<text x="{middle:.1f}" y="{first:.1f}" font-weight="600">{escape(box.title)}</text>']
    text += [
        f'<text x="{middle:.1f}" y="{first + LINE * (number + 1):.1f}">{escape(line)}</text>'
        for number, line in enumerate(box.lines)
    ]
    return (
        f'<rect x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}" rx="5" fill="{fill}" '
        f'stroke="{stroke}"/><g text-anchor="middle" fill="#1d2529">{"".join(text)}</g>'
    )


def _arrow(
    start: tuple[float, float, float, float], end: tuple[float, float, float, float], label: str
) -> str:
    x1, y1, w1, h1 = start
    x2, y2, w2, h2 = end
    if y1 == y2:
        y = y1 + min(h1, h2) / 2
        ends = (x1 + w1 + 2, y, x2 - 3, y) if x1 < x2 else (x1 - 2, y, x2 + w2 + 3, y)
    else:
        low, high = max(x1, x2), min(x1 + w1, x2 + w2)
        straight = (low + high) / 2 if low < high else None
        a, b = (straight, straight) if straight is not None else (x1 + w1 / 2, x2 + w2 / 2)
        ends = (a, y1 + h1 + 2, b, y2 - 3) if y1 < y2 else (a, y1 - 2, b, y2 + h2 + 3)
    ax, ay, bx, by = ends
    line = (
        f'<line x1="{ax:.1f}" y1="{ay:.1f}" x2="{bx:.1f}" y2="{by:.1f}" stroke="#51616b" '
        'stroke-width="1.4" marker-end="url(#arrow)"/>'
    )
    if not label:
        return line
    beside = ay != by
    x, y = ((ax + bx) / 2 + (7 if beside else 0), (ay + by) / 2 + (4 if beside else -6))
    anchor = "start" if beside else "middle"
    return f'{line}<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" fill="#51616b">{escape(label)}</text>'


def levels() -> str:
    boxes = [
        Box("run", 0, 0, "run", ("mean over", "counted frames")),
        Box("session", 1, 0, "session", ("mean log ratio", "over pairs of runs")),
        Box("installation", 2, 0, "installation", ("mean over", "sessions")),
        Box("network", 2, 1, "network", ("mean over", "installations")),
        Box("model", 1, 1, "device model", ("robust mean", "over networks"), accent=True),
        Box("crowd", 0, 1, "crowd", ("random-effects mean", "over models"), accent=True),
    ]
    names = ["run", "session", "installation", "network", "model", "crowd"]
    return diagram(boxes, [(a, b, "") for a, b in pairwise(names)])


def tables() -> str:
    boxes = [
        Box("devices", 0, 0, "devices", ("what the public sees",)),
        Box("sessions", 1, 0, "sessions", ("order, temperature, clock",)),
        Box("runs", 2, 0, "runs", ("time of every frame",)),
        Box("states", 3, 0, "run_states", ("value, state, reason",), accent=True),
        Box("figures", 0, 1, "figures", ("speedup and interval",), accent=True),
        Box("summaries", 1, 1, "summaries", ("speedup, state, reason",), accent=True),
        Box("configurations", 2, 1, "configurations", ("points of fronts",)),
    ]
    arrows = [
        ("devices", "sessions", "device"),
        ("sessions", "runs", "session"),
        ("runs", "states", "run"),
        ("sessions", "summaries", "session"),
        ("devices", "figures", "device"),
        ("configurations", "runs", "configuration"),
    ]
    return diagram(boxes, arrows)


def client() -> str:
    boxes = [
        Box("manifest", 0, 0, "1 manifest", ("what to measure",)),
        Box("sequence", 1, 0, "2 sequence", ("once, by digest",)),
        Box("consent", 2, 0, "consent", ("show everything, ask",), accent=True),
        Box("measure", 2, 1, "3 measure", ("default, best, best, default",)),
        Box("enrol", 1, 1, "4 enrol", ("a token, once",)),
        Box("send", 0, 1, "5 send", ("same bytes, same key",)),
    ]
    names = ["manifest", "sequence", "consent", "measure", "enrol", "send"]
    return diagram(boxes, [(a, b, "") for a, b in pairwise(names)])


def elasticfusion() -> str:
    boxes = [
        Box("preprocessing", 0, 0, "preprocessing", ("filter, normals, radii",)),
        Box("tracking", 1, 0, "tracking", ("rotation, then depth", "and brightness")),
        Box("integration", 2, 0, "integration", ("loops, fusion, removal",), accent=True),
        Box("map", 2, 1, "map", ("surfels, active and inactive",)),
        Box("prediction", 1, 1, "raycasting", ("splats the active map",)),
        Box("keyframes", 0, 1, "keyframes", ("ferns recognise places",)),
    ]
    arrows = [
        ("preprocessing", "tracking", ""),
        ("tracking", "integration", "pose"),
        ("integration", "map", ""),
        ("map", "prediction", ""),
        ("prediction", "tracking", "predicted model"),
        ("prediction", "keyframes", "new views"),
    ]
    return diagram(boxes, arrows)


def deployment() -> str:
    boxes = [
        Box("browsers", 0, 0, "browsers, clients", ("HTTPS",)),
        Box("proxy", 1, 0, "Caddy or nginx", ("TLS",)),
        Box("web", 2, 0, "web server", ("pages and API",), accent=True),
        Box("database", 2, 1, "database", ("SQLite or PostgreSQL",)),
        Box("workers", 1, 1, "workers", ("figures, open data, searches",)),
        Box("broker", 0, 1, "broker", ("files, Redis or RabbitMQ",)),
    ]
    arrows = [
        ("browsers", "proxy", ""),
        ("proxy", "web", "HTTP"),
        ("web", "database", ""),
        ("workers", "database", ""),
        ("broker", "workers", "hints"),
    ]
    return diagram(boxes, arrows)


def packages() -> str:
    boxes = [
        Box("command", 1, 0, "frontrunner", ("the command",)),
        Box("client", 0, 1, "client_kit", ("measures and uploads",)),
        Box("crowd", 2, 1, "crowd", ("fronts, results, pages",), accent=True),
        Box("slam", 0, 2, "slam", ("systems, sequences, devices",)),
        Box("pareto", 2, 2, "pareto", ("spaces, search, fronts",)),
        Box("wire", 0, 3, "wire", ("what travels, declared once",)),
        Box("groundwork", 2, 3, "groundwork", ("version, folders, terminal",)),
    ]
    arrows = [
        ("command", "client", ""),
        ("command", "crowd", ""),
        ("client", "slam", ""),
        ("client", "pareto", ""),
        ("crowd", "slam", ""),
        ("crowd", "pareto", ""),
        ("slam", "wire", ""),
        ("pareto", "groundwork", ""),
    ]
    return diagram(boxes, arrows)


DIAGRAMS = {
    "levels": levels,
    "tables": tables,
    "client": client,
    "elasticfusion": elasticfusion,
    "deployment": deployment,
    "packages": packages,
}


def main() -> None:
    for name, draw in DIAGRAMS.items():
        (PICTURES / f"{name}.svg").write_text(draw(), encoding="utf-8")


if __name__ == "__main__":
    main()
