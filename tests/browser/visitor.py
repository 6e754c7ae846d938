"""A visitor who looks at pages and writes down whatever goes wrong while they load."""

from typing import Any


class Visitor:
    """One browser tab of a given width and colour scheme.

    `complaints` holds console errors and warnings, uncaught exceptions (a violation of the content security
    policy is a console error), failed requests, and requests to any other host than the server's.
    """

    def __init__(
        self, browser: Any, server: str, width: int = 1280, scheme: str = "light", **options: Any
    ) -> None:
        self.server = server
        self.scheme = scheme
        self.complaints: list[str] = []
        self.context = browser.new_context(
            viewport={"width": width, "height": 844}, color_scheme=scheme, **options
        )
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

    def _hear(self, message: Any) -> None:
        if message.type in {"error", "warning"}:
            self.complaints.append(f"{message.type}: {message.text}")

    def _watch(self, request: Any) -> None:
        if not request.url.startswith((self.server, "data:")):
            self.complaints.append(f"asked another host: {request.url}")

    def _check(self, response: Any) -> None:
        if response.status >= 400:
            self.complaints.append(f"{response.status}: {response.url}")
