"""A page of sections, as Markdown for a repository and as HTML with figures for a browser."""

from __future__ import annotations

import html
import re
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from pareto.plot.page import STYLE

if TYPE_CHECKING:
    from plotly.graph_objects import Figure


PROSE = """
.prose { max-height: none; }
.prose th, .prose td { text-align: left; white-space: normal; vertical-align: top; }
"""
WIDTH = 150  # characters of a line of Markdown, except in tables


@dataclass(frozen=True)
class Table:
    """A header and rows of cells; `prose`: they hold sentences, which may break."""

    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    prose: bool = False


@dataclass(frozen=True)
class Section:
    """A title, then paragraphs, tables, and figures with their alternative text; figures in HTML only."""

    title: str
    parts: tuple[str | Table | Figure, ...]


def write_markdown(path: Path, title: str, sections: Iterable[Section]) -> None:
    """Write the page without its figures."""
    blocks = [f"# {title}"]
    for section in sections:
        blocks += [f"## {section.title}"] if section.title else []
        for part in section.parts:
            if isinstance(part, Table):
                lines = [part.header, ["---"] * len(part.header), *part.rows]
                blocks.append("\n".join("| " + " | ".join(map(_cell, line)) + " |" for line in lines))
            elif isinstance(part, str):
                blocks.append(textwrap.fill(part, WIDTH, break_long_words=False, break_on_hyphens=False))
    path.write_text("\n\n".join(blocks) + "\n", encoding="utf-8")


def write_html(path: Path, title: str, sections: Iterable[Section]) -> None:
    """Write the page with its figures; Plotly's own code, some 5 MB, is in it."""
    from plotly.offline import get_plotlyjs

    body = "\n".join(
        f'<section class="wide"><h2>{html.escape(section.title)}</h2>\n'
        + "\n".join(map(_html, section.parts))
        + "</section>"
        for section in sections
    )
    path.write_text(
        '<!doctype html>\n<html lang="en">\n'
        f'<head><meta charset="utf-8"><title>{html.escape(title)}</title>\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'<link rel="icon" href="data:,">\n<style>{STYLE}{PROSE}</style>\n'
        f"<script>{get_plotlyjs()}</script></head>\n"
        f'<body>\n<h1>{html.escape(title)}</h1>\n<div class="pictures">\n{body}\n</div>\n</body>\n</html>\n',
        encoding="utf-8",
    )


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def _inline(text: str) -> str:
    """Text with `code` as HTML."""
    return re.sub(r"`([^`]+)`", r"<code>\1</code>", html.escape(text))


def _html(part: str | Table | Figure) -> str:
    if isinstance(part, str):
        return f"<p>{_inline(part)}</p>"
    if isinstance(part, Table):
        head = "".join(f"<th>{html.escape(cell)}</th>" for cell in part.header)
        body = "\n".join(
            "<tr>" + "".join(f"<td>{_inline(cell)}</td>" for cell in row) + "</tr>" for row in part.rows
        )
        return (
            f'<div class="scroll{" prose" * part.prose}" tabindex="0"><table><thead><tr>{head}</tr></thead>\n'
            f"<tbody>{body}</tbody></table></div>"
        )
    drawing: str = part.to_html(
        full_html=False, include_plotlyjs=False, config={"displaylogo": False, "responsive": True}
    )
    return drawing
