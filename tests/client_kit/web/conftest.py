"""A real Chromium with WebGPU on its software adapter, and the browser's modules on a server."""

from collections.abc import Iterator
from typing import Any

import pytest

from tests.browser.chromium import NoBrowserError, launched
from tests.browser.firefox import FirefoxPage, firefox
from tests.client_kit.web.serving import WebServer, served

__all__ = ["firefox"]

FLAGS = ("--enable-unsafe-webgpu", "--use-webgpu-adapter=swiftshader")


PLACES = ("webgpu", "wasm", "wasm-firefox")  # of the kernels' tests


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[Any]) -> None:
    """Of the kernels' tests each row runs in one place, and each test in each: elsewhere a row is exhaustive.

    All rows run in all backends of Python, in `tests.slam.conformance`.
    """
    rows: dict[Any, list[Any]] = {}
    for item in items:
        if item.path.name == "test_conformance_in_browser.py":
            rows.setdefault((item.originalname, item.callspec.params["place"]), []).append(item)
    for (_, place), same in rows.items():
        turn = PLACES.index(place)
        for number, item in enumerate(same):
            if number % len(PLACES) != turn and not (number == 0 and turn >= len(same)):
                item.add_marker(pytest.mark.exhaustive)


@pytest.fixture(scope="package")
def web_server() -> Iterator[WebServer]:
    with served() as server:
        yield server


@pytest.fixture(scope="package")
def web_browser() -> Iterator[Any]:
    """The installed browser, started once; a skip with its reason where there is none."""
    try:
        with launched(*FLAGS) as browser:
            yield browser
    except NoBrowserError as reason:
        pytest.skip(str(reason))


@pytest.fixture(scope="module")
def web_page(web_browser: Any, web_server: WebServer) -> Iterator[Any]:
    """A page on which modules can be imported from /measure/."""
    page = web_browser.new_page()
    page.goto(web_server.url)
    assert page.evaluate("crossOriginIsolated")
    yield page
    page.close()


@pytest.fixture(scope="module")
def gpu_page(web_page: Any) -> Any:
    """The same, with a WebGPU adapter; a skip where this browser has none."""
    if not web_page.evaluate("navigator.gpu?.requestAdapter().then(Boolean)"):
        pytest.skip("this Chromium has no WebGPU adapter")
    return web_page


@pytest.fixture(scope="module")
def firefox_page(firefox: FirefoxPage, web_server: WebServer) -> FirefoxPage:
    """The same page in Firefox."""
    firefox.goto(web_server.url)
    assert firefox.evaluate("() => crossOriginIsolated")
    return firefox
