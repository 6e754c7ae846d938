"""The steps of someone who measures in a browser, and what they leave behind."""

import re
from pathlib import Path
from typing import Any

from crowd.devices.models import AttemptCount
from tests.browser.visitor import Visitor
from tests.client_kit.web.serving import WEB
from tests.waiting import until

# The page asks its worker for the next run as soon as one is on disk: here not after AFTER of them.
HOLD = """
    const post = Worker.prototype.postMessage;
    let runs = 0;
    Worker.prototype.postMessage = function (message, ...rest) {
        const goOn = () => post.call(this, message, ...rest);
        if (message.type === "next" && ++runs === AFTER) window.goOn = goOn;
        else goOn();
    };
"""


def hold_after(visitor: Visitor, runs: int) -> None:
    """The visitor's pages wait after so many runs, until `go_on`."""
    visitor.page.add_init_script(HOLD.replace("AFTER", str(runs)))


def held(page: Any) -> None:
    """It waits now."""
    page.wait_for_function("() => Boolean(window.goOn)")


def go_on(page: Any) -> None:
    page.evaluate("window.goOn()")


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

    def counted() -> list[str]:
        rows = AttemptCount.objects.all()
        return sorted(f"{row.step} {row.reason}".strip() for row in rows for _ in range(row.count))

    until(lambda: len(counted()) >= len(expected), seen=counted)
    assert counted() == sorted(expected)


def widest_interval(folder: Path, ratio: str) -> None:
    """In the web client's copy in `folder`, wider intervals than `ratio`, JavaScript, have no point."""
    constants = (WEB / "constants.js").read_text(encoding="utf-8")
    changed = constants.replace("WIDEST_INTERVAL = 1.5;", f"WIDEST_INTERVAL = {ratio};")
    assert changed != constants
    (folder / "web" / "constants.js").write_text(changed, encoding="utf-8")
