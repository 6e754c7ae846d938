"""A visitor who looks at pages and writes down whatever goes wrong while they load."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from tests.waiting import PATIENCE_SECONDS, until

# Resolves when no transition of the style sheet is under way.
TRANSITIONS = """() => {
    const running = document.getAnimations().filter((each) => each instanceof CSSTransition);
    return Promise.allSettled(running.map(({ finished }) => finished)).then(() => undefined);
}"""


@contextmanager
def all_answered() -> Iterator[None]:
    """Wait at the end until the server has answered what closed pages had asked since the beginning."""
    before = set(threading.enumerate())  # a test elsewhere may have left a connection open

    def busy() -> list[str]:
        new = set(threading.enumerate()) - before
        return [thread.name for thread in new if "process_request_thread" in thread.name]

    yield
    until(lambda: not busy(), 2 * PATIENCE_SECONDS, seen=busy)  # an idle connection stays for two minutes


class Visitor:
    """One browser tab of a given width and colour scheme.

    `complaints` holds console errors and warnings, uncaught exceptions (a violation of the content security
    policy is a console error), failed requests, and requests to any other host than the server's.
    """

    def __init__(
        self, browser: Any, server: str, width: int = 1280, scheme: str = "light", **options: Any
    ) -> None:
        self.server = server
        self.complaints: list[str] = []
        self.context = browser.new_context(
            viewport={"width": width, "height": 844}, color_scheme=scheme, **options
        )
        self.context.set_default_timeout(PATIENCE_SECONDS * 1000)  # of all its tabs
        self.open_tab()

    def open_tab(self) -> None:
        """Go on in a new tab, without complaints."""
        self.complaints.clear()
        self.page = self.context.new_page()
        self.page.on("console", self._hear)
        self.page.on("pageerror", lambda error: self.complaints.append(f"exception: {error}"))
        self.page.on("request", self._watch)
        self.page.on("response", self._check)

    def open(self, path: str) -> Any:
        """The page at `path` with every figure in sight drawn (or failed, which is a complaint)."""
        self.page.goto(f"{self.server}{path}", wait_until="load")
        figures = self.page.locator("figure[data-figure]:visible")
        for number in range(figures.count()):
            self.page.locator("figure[data-drawn]:visible").nth(number).wait_for()
        if self.page.locator("figure[data-drawn=failed]").count():
            self.complaints.append(f"a figure of {path} failed: {figures.all_inner_texts()}")
        return self.page

    def shows(self, text: str, where: str = "body") -> None:
        """The element `where` has `text`, now or a moment later."""
        self.page.locator(where, has_text=text).first.wait_for()

    def fits(self) -> bool:
        """Whether the page can be read without scrolling sideways."""
        return bool(self.page.evaluate("document.documentElement.scrollWidth <= innerWidth"))

    def barriers(self, **options: Any) -> list[Any]:
        """The serious ones that axe finds for screen readers and weak eyes."""
        from axe_playwright_python.sync_playwright import Axe

        # A colour that still changes has another contrast.
        self.page.evaluate(TRANSITIONS)
        found = Axe().run(self.page, options={"resultTypes": ["violations"]}, **options).response
        return [
            (rule["id"], rule["help"], [node["html"][:200] for node in rule["nodes"]])
            for rule in found["violations"]
            if rule["impact"] in {"serious", "critical"}
        ]

    def _hear(self, message: Any) -> None:
        if message.type in {"error", "warning"}:
            self.complaints.append(f"{message.type}: {message.text}")

    def _watch(self, request: Any) -> None:
        if not request.url.startswith((self.server, "data:")):
            self.complaints.append(f"asked another host: {request.url}")

    def _check(self, response: Any) -> None:
        if response.status >= 400:
            self.complaints.append(f"{response.status}: {response.url}")
