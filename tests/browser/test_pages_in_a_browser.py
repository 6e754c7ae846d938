"""What a visitor sees: charts drawn under the real security policy, on a phone and a desk, light and dark."""

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from crowd.dashboard.palette import DARK, LIGHT
from crowd.explorations import services
from crowd.explorations.models import Exploration
from tests.browser.visitor import Visitor
from tests.dashboard import searches

Visit = Callable[..., Visitor]


@pytest.fixture
def visit(chromium: Any, live_server: Any, measured: list[dict[str, Any]]) -> Iterator[Visit]:
    """Opens tabs on the server with five measured phones, and closes them at the end."""
    opened: list[Visitor] = []

    def tab(**options: Any) -> Visitor:
        opened.append(Visitor(chromium, live_server.url, **options))
        return opened[-1]

    yield tab
    for visitor in opened:
        visitor.context.close()


def test_charts_are_drawn_and_say_what_they_show(visit: Visit) -> None:
    page = visit().open("/devices/google-pixel-8/")

    plots = page.locator("figure .plot")
    assert plots.count() == 2
    for number in range(2):
        assert plots.nth(number).locator("svg.main-svg").count() > 0
        assert plots.nth(number).get_attribute("aria-label")
    # Four runs, and three stages and more in two bars.
    assert page.locator(".scatterlayer .trace").count() == 4
    assert page.locator(".barlayer .point").count() == 8


def test_charts_change_their_colours_with_the_system(visit: Visit) -> None:
    visitor = visit(scheme="light")
    page = visitor.open("/devices/google-pixel-8/")
    lines = (
        "[...document.querySelectorAll('.scatterlayer .js-line')].map(line => getComputedStyle(line).stroke)"
    )
    assert rgb(LIGHT.best) in page.evaluate(lines)

    page.emulate_media(color_scheme="dark")
    page.locator("figure[data-drawn=dark]").nth(1).wait_for()

    assert rgb(DARK.best) in page.evaluate(lines)
    assert visitor.complaints == []


def test_a_bar_leads_to_its_device(visit: Visit) -> None:
    page = visit().open("/")

    page.locator(".barlayer .point").first.click(force=True)

    page.wait_for_url("**/devices/google-pixel-8/")


def test_a_chart_that_cannot_be_fetched_says_so_and_points_to_the_table(visit: Visit) -> None:
    visitor = visit()
    visitor.page.route("**/figures/**", lambda route: route.abort())

    page = visitor.open("/")

    assert "This chart could not be drawn" in page.locator("figure .plot").inner_text()
    assert page.locator("table tbody tr").count() == 5


def test_without_scripts_the_numbers_are_all_there(visit: Visit) -> None:
    visitor = visit(java_script_enabled=False)
    visitor.page.goto(f"{visitor.server}/")

    assert visitor.page.locator("table tbody tr").count() == 5
    assert visitor.page.get_by_text("faster across 5 devices").is_visible()
    assert not visitor.page.locator("figure .plot").is_visible()
    assert visitor.complaints == []


def test_the_first_tab_stop_skips_to_the_content(visit: Visit) -> None:
    page = visit().open("/")

    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.textContent") == "Skip to the content"
    page.keyboard.press("Enter")

    assert page.evaluate("document.activeElement.id") == "content"


def test_filters_change_the_address_and_the_chart(visit: Visit) -> None:
    page = visit().open("/devices/")
    assert page.locator(".barlayer .point").count() == 5

    page.get_by_label("GPU contains").fill("T4")
    page.get_by_role("button", name="Show").click()
    page.locator("figure[data-drawn]").first.wait_for()

    assert "gpu=T4" in page.url
    assert page.locator(".barlayer .point").count() == 1


def test_an_exploration_s_page_follows_it_without_loading_again(visit: Visit) -> None:
    visitor = visit()
    search = Exploration.objects.get()
    page = visitor.open(f"/explorations/{search.pk}/")
    page.evaluate("window.loadedOnce = true")
    page.get_by_text("0 of 4 configurations searched").wait_for()
    marks = page.locator("#plane ~ figure .points path").count()

    searches.measure(search, [(0.03, 0.05), (0.049, 0.01), (0.5, 0.004), None])

    page.get_by_text("4 of 4 configurations searched").wait_for(timeout=15_000)
    page.get_by_text("Why 2 measurements failed").wait_for()
    page.wait_for_function(
        "marks => document.querySelectorAll('#plane ~ figure .points path').length > marks", arg=marks
    )
    services.cancel(search)
    page.locator(".state-cancelled").wait_for(timeout=15_000)
    assert page.evaluate("window.loadedOnce")
    assert visitor.complaints == []


def rgb(colour: str) -> str:
    """#rrggbb as browsers compute it."""
    red, green, blue = (int(colour[start : start + 2], 16) for start in (1, 3, 5))
    return f"rgb({red}, {green}, {blue})"
