"""The steps of someone who measures in a browser, and what they leave behind."""

import re
from typing import Any

from crowd.devices.models import AttemptCount
from tests.browser.visitor import Visitor
from tests.waiting import until


def begin(visitor: Visitor) -> Any:
    """The page, agreed and started."""
    page = visitor.page
    page.goto(f"{visitor.server}/measure/")
    page.locator("#start").click()
    return page


def finished(page: Any, state: str = "unconfirmed") -> Any:
    """The result, as soon as it has that `state`, or another one that stays."""
    page.locator(f"#result:is([data-state={state}], [data-state=suspect], [data-state=invalid])").wait_for()
    result = page.locator("#result")
    assert result.get_attribute("data-state") == state, result.inner_text()
    return result


def arrived(page: Any) -> Any:
    """The sessions in the list that the server has."""
    return page.locator("#sessions").get_by_text(re.compile(", sent$"))


def assert_counted(*expected: str) -> None:
    """These steps of visitors and no others are counted, as soon as what the page sent has arrived."""
    until(lambda: AttemptCount.objects.count() >= len(expected), 30)
    rows = AttemptCount.objects.all()
    counted = [f"{row.step} {row.reason}".strip() for row in rows for _ in range(row.count)]
    assert sorted(counted) == sorted(expected)
