"""Figures as one HTML file that needs no network."""

from __future__ import annotations

import html
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from plotly.graph_objects import Figure


class MissingPlotlyError(RuntimeError):
    """Figures need Plotly, which is not installed."""


def plotly() -> ModuleType:
    """`plotly.graph_objects`. Raises MissingPlotlyError where it is not installed."""
    try:
        import plotly.graph_objects as go
    except ImportError:
        raise MissingPlotlyError(
            "figures need Plotly, which is not installed here: pip install plotly"
        ) from None
    graph_objects: ModuleType = go
    return graph_objects


def escape(text: str) -> str:
    """Text escaped for Plotly, which reads simple HTML in every label."""
    return html.escape(text, quote=False)


def save(path: Path, title: str, figures: Sequence[Figure]) -> None:
    """Write the figures below each other; Plotly's own code, some 5 MB, comes with the first."""
    parts = [
        figure.to_html(full_html=False, include_plotlyjs=number == 0) for number, figure in enumerate(figures)
    ]
    head = f'<meta charset="utf-8"><title>{html.escape(title)}</title>'
    body = "\n".join(parts)
    path.write_text(
        f'<!doctype html>\n<html lang="en">\n<head>{head}</head>\n<body>\n{body}\n</body>\n</html>\n',
        encoding="utf-8",
    )
