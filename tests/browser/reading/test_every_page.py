"""Every page of the site: in light and dark, on a phone and a desk, with and without scripts."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.browser.reading.site import Site, page_names
from tests.browser.visitor import Visitor
from tests.waiting import until

# A transaction for each test: what the site was filled with stays until the last one.
pytestmark = pytest.mark.django_db

DESK, PHONE = 1280, 390
WIDTHS = {"light": DESK, "dark": PHONE}
HERE = Path(__file__).parent
STRUCTURE = (HERE / "structure.js").read_text()
OVERFLOW = (HERE / "overflow.js").read_text()
# The inside of a picture is not read out: its name is.
AXE_CONTEXT = {"exclude": [[".plot .plot-container"]]}


@pytest.fixture(scope="module")
def visitor(chromium: Any, site: Site) -> Iterator[Visitor]:
    """One tab for all pages."""
    one = Visitor(chromium, site.url)
    yield one
    one.context.close()


@pytest.fixture(scope="module")
def reader(chromium: Any, site: Site) -> Iterator[Visitor]:
    """Somebody whose browser runs no scripts."""
    one = Visitor(chromium, site.url, java_script_enabled=False)
    yield one
    one.context.close()


def visits() -> list[Any]:
    """Each page opened in one theme, at its width, and then changed to the other; the other way round as well
    in `make test-all`.
    """
    return [
        pytest.param(
            name, first, id=f"{first}-{name}", marks=[pytest.mark.exhaustive] * ((number + turn) % 2)
        )
        for number, name in enumerate(page_names())
        for turn, first in enumerate(WIDTHS)
    ]


def show(page: Any, scheme: str) -> None:
    page.set_viewport_size({"width": WIDTHS[scheme], "height": 844})
    page.emulate_media(color_scheme=scheme)


@pytest.mark.parametrize(("name", "first"), visits())
def test_a_page_is_sound_at_every_width_in_every_theme(
    site: Site, visitor: Visitor, name: str, first: str
) -> None:
    visitor.complaints.clear()
    show(visitor.page, first)
    page = visitor.open(site.pages[name])
    found: dict[str, Any] = {"structure": page.evaluate(STRUCTURE)}

    for scheme in sorted(WIDTHS, key=lambda scheme: scheme != first):
        show(page, scheme)
        # Charts follow the window and the theme a moment later.
        drawn = "".join(f":not([data-drawn={state}])" for state in (scheme, "here", "failed"))
        page.locator(f"figure[data-figure]{drawn}:visible").first.wait_for(state="hidden")
        until(lambda: page.evaluate(OVERFLOW) == [], seen=lambda: page.evaluate(OVERFLOW))
        found[f"barriers in {scheme}"] = visitor.barriers(context=AXE_CONTEXT)
        found[f"charts that failed in {scheme}"] = page.locator("figure[data-drawn=failed]").count()

    assert {what: wrong for what, wrong in found.items() if wrong} == {}
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
