"""Every page of the site: in light and dark, on a phone and a desk, with and without scripts."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.browser.reading.site import Site, page_names
from tests.browser.visitor import Visitor

# A transaction for each test: what the site was filled with stays until the last one.
pytestmark = pytest.mark.django_db

DESK, PHONE = 1280, 390
# A page is opened at the width of its theme and then made as wide as the other theme's.
WIDTHS = {"light": (DESK, PHONE), "dark": (PHONE, DESK)}
HERE = Path(__file__).parent
STRUCTURE = (HERE / "structure.js").read_text()
OVERFLOW = (HERE / "overflow.js").read_text()
# The inside of a picture is not read out: its name is.
AXE_CONTEXT = {"exclude": [[".plot .plot-container"]]}
AXE_OPTIONS = {"resultTypes": ["violations"]}


@pytest.fixture(scope="module", params=WIDTHS)
def visitor(chromium: Any, site: Site, request: pytest.FixtureRequest) -> Iterator[Visitor]:
    """One tab a theme."""
    one = Visitor(chromium, site.url, width=WIDTHS[request.param][0], scheme=request.param)
    yield one
    one.context.close()


@pytest.fixture(scope="module")
def reader(chromium: Any, site: Site) -> Iterator[Visitor]:
    """Somebody whose browser runs no scripts."""
    one = Visitor(chromium, site.url, java_script_enabled=False)
    yield one
    one.context.close()


@pytest.mark.parametrize("name", page_names())
def test_a_page_is_sound_at_every_width_in_every_theme(site: Site, visitor: Visitor, name: str) -> None:
    from axe_playwright_python.sync_playwright import Axe

    visitor.complaints.clear()
    first, second = WIDTHS[visitor.scheme]
    visitor.page.set_viewport_size({"width": first, "height": 844})

    page = visitor.open(site.pages[name])
    assert visitor.complaints == []
    assert page.evaluate(OVERFLOW) == []
    assert page.evaluate(STRUCTURE) == []
    found = Axe().run(page, context=AXE_CONTEXT, options=AXE_OPTIONS).response["violations"]
    assert [
        (rule["id"], rule["help"], [node["html"][:200] for node in rule["nodes"]])
        for rule in found
        if rule["impact"] in {"serious", "critical"}
    ] == []

    page.set_viewport_size({"width": second, "height": 844})
    # Charts follow the window a moment later.
    page.wait_for_function(f"() => ({OVERFLOW})().length === 0", timeout=30_000)
    assert visitor.complaints == []


@pytest.mark.parametrize("name", page_names())
def test_a_page_says_in_words_and_tables_what_its_figures_show(
    site: Site, reader: Visitor, name: str
) -> None:
    reader.complaints.clear()
    page = reader.page
    page.goto(f"{site.url}{site.pages[name]}")

    assert page.locator("h1").is_visible()
    figures = page.locator("figure[data-figure]")
    for number in range(figures.count()):
        assert figures.nth(number).locator("figcaption").is_visible()
        assert not figures.nth(number).locator(".plot").is_visible()
    if figures.count():
        assert page.locator("table tbody tr").count() > 0
    assert reader.complaints == []
