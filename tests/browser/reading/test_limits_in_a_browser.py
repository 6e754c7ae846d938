"""The slider of the error on a device's page: with a script it changes the answer in place, without one it is
part of a form.
"""

from typing import Any

import pytest

from tests.browser.reading.site import Site
from tests.browser.visitor import Visitor
from tests.waiting import until

# A transaction for each test: what the site was filled with stays until the last one.
pytestmark = pytest.mark.django_db

FIGURE = "figure[data-name=frontrunner-device-front]"


def test_the_slider_changes_answer_and_figure_without_a_reload(chromium: Any, site: Site) -> None:
    visitor = Visitor(chromium, site.url, width=360)
    page = visitor.open(site.pages["device"])
    visitor.shows("best: ", "#advice .lede")
    page.evaluate("window.loadedOnce = true")
    slider = page.get_by_label("Error up to")
    assert slider.get_attribute("aria-valuetext") == "5.00\N{NARROW NO-BREAK SPACE}cm"

    slider.focus()
    page.keyboard.press("Home")
    page.wait_for_url("**?max_ate=0.008")
    page.locator(f"{FIGURE}[data-figure$='max_ate=0.008'][data-drawn]").wait_for()

    assert page.evaluate("window.loadedOnce")
    until(lambda: page.evaluate("document.activeElement.id") == "max-ate")
    visitor.shows("0.80\N{NARROW NO-BREAK SPACE}cm", "output")
    visitor.shows("accurate: ", "#advice .lede")
    visitor.shows("at most 0.8 cm", f"{FIGURE} .annotation-text >> nth=0")
    assert visitor.complaints == []
    visitor.context.close()


def test_without_scripts_the_slider_is_sent_with_the_form(chromium: Any, site: Site) -> None:
    visitor = Visitor(chromium, site.url, java_script_enabled=False)
    page = visitor.page
    page.goto(f"{site.url}{site.pages['device']}")

    page.get_by_label("Error up to").focus()
    page.keyboard.press("Home")
    page.locator("section:has(#own-front)").get_by_role("button", name="Show").click()

    page.wait_for_url("**?max_ate=0.008#own-front")
    visitor.shows("accurate: ", "#advice .lede")
    visitor.context.close()
