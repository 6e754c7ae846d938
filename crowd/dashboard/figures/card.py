"""The preview picture of links to a page: its figure in large letters, above the bars of the crowd."""

import io
import math
import unicodedata
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass

from PIL import Image, ImageDraw, ImageFont

from crowd.dashboard import formats
from crowd.dashboard.figures.palette import LIGHT

WIDTH, HEIGHT = 1200, 630
MARGIN = 72
FIGURE_SIZES = (132, 116, 100)
CURVE = ((5, 6, 13, 29), (3, 17, 25, 26))  # x and y of a cubic Bezier curve, as in mark.svg
EMPTY_MARK = 190  # pixels, where there are no bars to draw
SCOPE = 760  # widest scope, pixels
NOTE_LINES = 2
PAPER = "#f4f6f5"
# The vertical range of bars. If there are too many devices, every n-th is drawn.
TOP, BOTTOM = 440, 582
MOST_BARS = 352
PITCHES = (3, 40)  # minimum and maximum width of a bar with its gap, pixels


@dataclass(frozen=True)
class Card:
    """The content of a card. `bars`: speedups of the crowd, largest first.

    `lit`: the highlighted bar, None for all. `scope`: the filters in words.
    """

    title: str
    figure: str
    note: str
    bars: tuple[float, ...] = ()
    lit: int | None = None
    scope: str = ""


def png(card: Card) -> bytes:
    """`card` as a PNG of WIDTH x HEIGHT."""
    image = Image.new("RGB", (WIDTH, HEIGHT), PAPER)
    draw = ImageDraw.Draw(image)
    image.paste(_mark(52), (MARGIN - 6, 50))
    draw.text((MARGIN + 56, 76), "Frontrunner", LIGHT.ink, _font(34), anchor="lm")
    scope = _fitting(draw, card.scope, 26, SCOPE)
    draw.text((WIDTH - MARGIN, 76), scope, LIGHT.muted, _font(26), anchor="rm")
    draw.text((MARGIN, 160), _fitting(draw, card.title, 46), LIGHT.ink, _font(46), anchor="lm")
    size = _largest(draw, card.figure, FIGURE_SIZES)
    draw.text((MARGIN, 266), _fitting(draw, card.figure, size), LIGHT.best, _font(size), anchor="lm")
    draw.multiline_text((MARGIN, 352), _wrapped(draw, card.note, 30, NOTE_LINES), LIGHT.muted, _font(30))
    if card.bars:
        _draw_bars(draw, card)
    else:
        image.paste(_mark(EMPTY_MARK), (WIDTH - MARGIN - EMPTY_MARK, BOTTOM - EMPTY_MARK))
    packed = io.BytesIO()
    image.quantize(64).save(packed, "PNG", optimize=True)
    return packed.getvalue()


def plain(text: str) -> str:
    """`text` in one line and in ASCII, which is all that the built-in font has."""
    signs = {formats.TIMES: "x", formats.RANGE: "-", formats.ABSENT: "-", "\N{MINUS SIGN}": "-"}
    for sign, letter in signs.items():
        text = text.replace(sign, letter)
    decomposed = unicodedata.normalize("NFKD", text)
    kept = "".join(letter for letter in decomposed if not unicodedata.combining(letter))
    return " ".join(kept.encode("ascii", "replace").decode().split())


def _draw_bars(draw: ImageDraw.ImageDraw, card: Card) -> None:
    every = -(-len(card.bars) // MOST_BARS)
    drawn = {rank: value for rank, value in enumerate(card.bars) if rank % every == 0 or rank == card.lit}
    pitch = min(max((WIDTH - 2 * MARGIN) // len(drawn), PITCHES[0]), PITCHES[1])
    scale = (BOTTOM - TOP) / max(*card.bars, 1.0)
    for number, (rank, value) in enumerate(drawn.items()):
        left = MARGIN + number * pitch
        lit = card.lit is None or rank == card.lit
        draw.rectangle(
            (left, BOTTOM - value * scale, left + pitch - max(1, pitch // 6) - 1, BOTTOM),
            fill=LIGHT.best if lit else "#b4bfc9",
        )
    no_gain = BOTTOM - scale
    for x in range(MARGIN, WIDTH - MARGIN, 12):
        draw.line((x, no_gain, x + 5, no_gain), LIGHT.ink, 2)


def _mark(size: int) -> Image.Image:
    """The site's mark (mark.svg) in a square of `size`: a front, and a point ahead of it."""
    # Pillow draws without smooth edges: drawn four times as large.
    scale = 4 * size / 32
    image = Image.new("RGB", (4 * size, 4 * size), PAPER)
    draw = ImageDraw.Draw(image)

    def disc(x: float, y: float, radius: float, colour: str) -> None:
        box = (x - radius, y - radius, x + radius, y + radius)
        draw.ellipse(tuple(scale * edge for edge in box), fill=colour)

    for step in range(201):
        t = step / 200
        weights = ((1 - t) ** 3, 3 * (1 - t) ** 2 * t, 3 * (1 - t) * t**2, t**3)
        x, y = (sum(w * p for w, p in zip(weights, path, strict=True)) for path in CURVE)
        disc(x, y, 1.5, LIGHT.ink)
    disc(11.5, 18.5, 7, PAPER)
    disc(11.5, 18.5, 5, LIGHT.best)
    return image.resize((size, size), Image.Resampling.LANCZOS)


def _largest(draw: ImageDraw.ImageDraw, text: str, sizes: Sequence[int]) -> int:
    """The first of `sizes`, which become smaller, at which `text` is not cut; else the last."""
    whole = plain(text)
    return next((size for size in sizes if _fitting(draw, text, size) == whole), sizes[-1])


def _font(size: int) -> ImageFont.FreeTypeFont:
    font = ImageFont.load_default(size)
    assert isinstance(font, ImageFont.FreeTypeFont)  # Pillow's wheels bring FreeType
    return font


def _wrapped(draw: ImageDraw.ImageDraw, text: str, size: int, most: int) -> str:
    """`text` in at most `most` lines; the last one is cut at the edge of the card."""
    lines, words = [""], plain(text).split()
    for number, word in enumerate(words):
        longer = f"{lines[-1]} {word}".strip()
        if draw.textlength(longer, _font(size)) <= WIDTH - 2 * MARGIN:
            lines[-1] = longer
        elif len(lines) < most:
            lines.append(word)
        else:
            lines[-1] = _fitting(draw, " ".join([lines[-1], *words[number:]]), size)
            break
    return "\n".join(lines)


def _fitting(draw: ImageDraw.ImageDraw, text: str, size: int, room: int = WIDTH - 2 * MARGIN) -> str:
    """`text` cut to the width `room` (pixels), by default the width of the card.

    A binary search needs about ten measurements, however long `text` is.
    """
    # Every letter is at least one pixel wide.
    shown, font = plain(text)[: room + 1], _font(size)
    if draw.textlength(shown, font) <= room:
        return shown

    def cut(letters: int) -> str:
        return shown[:letters].rstrip() + "..."

    def width(letters: int) -> int:
        return math.ceil(draw.textlength(cut(letters), font))

    wider = bisect_right(range(len(shown)), room, key=width)
    return cut(wider - 1)
