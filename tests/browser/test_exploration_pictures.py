"""The pictures of `python -m pareto`, opened from disk in a real browser."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from pareto.plot import save
from tests.browser.visitor import Visitor
from tests.pareto.plot.test_plot import explored
from tests.waiting import until


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a saved page."""
    folder = tmp_path_factory.mktemp("saved")
    save(explored(200, ("cost", "error", "quality"), limits={"error": 1.0}), folder / "front.html")
    return folder


@pytest.mark.parametrize("width", [390, 1280])
def test_the_page_draws_all_its_pictures_without_a_complaint_or_a_network(
    chromium: Any, saved: Path, width: int
) -> None:
    visitor = Visitor(chromium, f"file://{saved}", width)
    page = visitor.open("/front.html")
    pictures = page.locator(".js-plotly-plot")
    # Three planes, their fronts over time, the hypervolume, importance; slices of each objective, parallel
    # coordinates, and a prediction an objective.
    until(lambda: pictures.count() == 3 + 3 + 1 + 1 + 3 + 1 + 3, seen=pictures.count)
    for number in range(pictures.count()):
        pictures.nth(number).locator(".main-svg").first.wait_for()
        pictures.nth(number).locator(".trace, .parcoords").first.wait_for(state="attached")
    assert page.locator("tbody tr").count() > 1
    until(visitor.fits)
    # Parallel coordinates are drawn by WebGL, of which a software driver says that it is slow.
    assert [text for text in visitor.complaints if "GL Driver Message" not in text] == []
    visitor.context.close()
