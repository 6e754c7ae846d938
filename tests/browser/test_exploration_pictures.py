"""The pictures of `python -m pareto`, opened from disk in a real browser."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from pareto.plot import save
from tests.browser.visitor import Visitor
from tests.pareto.plot.test_plot import explored


@pytest.mark.parametrize("width", [390, 1280])
def test_the_page_draws_all_its_pictures_without_a_complaint_or_a_network(
    chromium: Any, tmp_path: Path, width: int
) -> None:
    save(explored(200, ("cost", "error", "quality"), limits={"error": 1.0}), tmp_path / "front.html")
    visitor = Visitor(chromium, f"file://{tmp_path}", width)
    page = visitor.open("/front.html")
    pictures = page.locator(".js-plotly-plot")
    # Three planes, their fronts over time, the hypervolume, importance; slices of each objective, parallel
    # coordinates, and a prediction an objective.
    assert pictures.count() == 3 + 3 + 1 + 1 + 3 + 1 + 3
    for number in range(pictures.count()):
        pictures.nth(number).locator(".main-svg").first.wait_for()
        assert pictures.nth(number).locator(".trace, .parcoords").count() > 0
    assert page.locator("tbody tr").count() > 1
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    # Parallel coordinates are drawn by WebGL, of which a software driver says that it is slow.
    assert [text for text in visitor.complaints if "GL Driver Message" not in text] == []
    visitor.context.close()
