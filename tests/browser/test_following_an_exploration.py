"""Who looks at a search while it runs sees it go on."""

from typing import Any

from crowd.explorations import services
from crowd.fronts.publishing.services import publish_content
from tests.browser.visitor import Visitor
from tests.builders import searches
from tests.builders.documents import front_document


def test_an_exploration_s_page_follows_it_without_loading_again(
    chromium: Any, live_server: Any, pack: dict[str, Any]
) -> None:
    publish_content(front_document(pack))
    search = searches.exploration(pack)
    visitor = Visitor(chromium, live_server.url)
    page = visitor.open(f"/explorations/{search.pk}/")
    page.evaluate("window.loadedOnce = true")
    page.get_by_text("The first configuration waits").wait_for()
    assert page.locator("figure").count() == 0

    searches.measure(search, searches.KNOWN)

    page.locator("#plane ~ figure[data-drawn]").wait_for()
    page.get_by_text("0 of 4 configurations searched").wait_for()
    marks = page.locator("#plane ~ figure .points path").count()

    searches.measure(search, [(0.03, 0.05), (0.049, 0.01), (0.5, 0.004), None])

    page.get_by_text("4 of 4 configurations searched").wait_for()
    page.get_by_text("Why 2 measurements failed").wait_for()
    page.wait_for_function(
        "marks => document.querySelectorAll('#plane ~ figure .points path').length > marks", arg=marks
    )
    services.cancel(search)
    page.locator(".state-cancelled").wait_for()
    assert page.evaluate("window.loadedOnce")
    assert visitor.complaints == []
    # A request that is still answered would lock the tables that the test leaves behind.
    page.wait_for_load_state("networkidle")
    visitor.context.close()
