"""Where a browser cannot measure, the page says why, and what to do."""

import copy
from pathlib import Path
from typing import Any

import pytest

from crowd.devices.models import AttemptCount, Installation
from crowd.fronts.publishing.services import publish_content
from crowd.results.models import MeasurementSession
from tests.browser.measuring.conftest import Published
from tests.browser.measuring.steps import assert_counted, begin
from tests.browser.visitor import Visitor
from tests.waiting import until


def test_a_shader_that_is_not_what_its_digest_says_is_refused(webgpu_visitor: Visitor) -> None:
    visitor = webgpu_visitor
    visitor.page.route(
        "**/shaders/*", lambda route: route.fulfill(body="{}", content_type="application/json")
    )
    page = begin(visitor)

    page.get_by_text("The download arrived damaged").wait_for()
    visitor.shows("SHA-256 differs", "#notice-detail")
    page.set_viewport_size({"width": 360, "height": 740})
    until(visitor.fits)
    assert MeasurementSession.objects.count() == 0


def test_a_device_that_computes_wrong_results_is_stopped_before_anything_is_timed(
    webgpu_visitor: Visitor, published: Published
) -> None:
    narrow = copy.deepcopy(published.document) | {"version": "narrow"}
    narrow["configurations"][1]["band"] = 1e-9
    publish_content(narrow)
    page = begin(webgpu_visitor)

    page.get_by_text("This device computes wrong results").wait_for()
    page.get_by_text("the band is 1e-9 m").wait_for()
    [counted] = until(lambda: AttemptCount.objects.filter(reason="wrong_results"))
    assert (counted.step, counted.gpu_architecture, counted.browser) == ("failed", "swiftshader", "Chrome")
    assert MeasurementSession.objects.count() == Installation.objects.count() == 0


def test_a_browser_that_cannot_measure_says_why(visitor: Visitor) -> None:
    visitor.page.add_init_script("delete Navigator.prototype.gpu; WebAssembly.validate = () => false")
    page = visitor.open("/measure/")

    page.get_by_text("This browser is too old to measure").wait_for()
    page.get_by_role("link", name="Browsers that can measure").wait_for()
    page.locator("#start").wait_for(state="hidden")
    assert_counted("unsupported no_wasm_simd")


def test_an_address_without_https_says_so_and_shows_no_qr_code(visitor: Visitor, settings: Any) -> None:
    settings.ALLOWED_HOSTS = ["*"]
    insecure = visitor.server.replace("localhost", "lab.test").replace("127.0.0.1", "lab.test")
    page = visitor.page
    page.goto(f"{insecure}/measure/")

    page.get_by_text("This address has no HTTPS").wait_for()
    page.goto(f"{insecure}/")
    page.get_by_text("Without HTTPS, browsers measure only").wait_for()
    assert page.locator(".qr-code").count() == 0


def test_a_storage_that_never_answers_is_named(visitor: Visitor) -> None:
    visitor.page.add_init_script("indexedDB.open = () => ({})")
    page = visitor.page
    page.goto(f"{visitor.server}/measure/")
    page.get_by_text("Checking this browser").wait_for()

    page.get_by_text("This browser's storage does not answer").wait_for()
    page.get_by_text("Checking this browser").wait_for(state="hidden")


@pytest.mark.parametrize(
    ("script", "words"),
    [
        (
            "Object.defineProperty(window, 'indexedDB', { value: undefined })",
            "This browser cannot keep measurements: storage is switched off",
        ),
        (
            "IDBFactory.prototype.open = () => { throw new DOMException('', 'SecurityError') }",
            "Allow this site to store data",
        ),
        ("Object.defineProperty(navigator, 'locks', { value: undefined })", "This browser is too old"),
    ],
)
def test_what_a_browser_lacks_is_said(visitor: Visitor, script: str, words: str) -> None:
    visitor.page.add_init_script(script)
    page = visitor.page
    page.goto(f"{visitor.server}/measure/")

    page.get_by_text(words).wait_for()
    page.get_by_text("Checking this browser").wait_for(state="hidden")
    page.locator("#start").wait_for(state="hidden")


@pytest.mark.parametrize(
    ("status", "problem", "words"),
    [
        (503, {}, "The server is busy"),
        (429, {}, "The server is busy"),
        (404, {"code": "no_front"}, "Nothing to measure yet"),
    ],
)
def test_a_server_without_an_answer_is_named_and_asked_again(
    visitor: Visitor, status: int, problem: dict[str, str], words: str
) -> None:
    page = visitor.page
    page.route("**/api/v1/manifest", lambda route: route.fulfill(status=status, json=problem))
    page.goto(f"{visitor.server}/measure/")
    page.get_by_text(words).wait_for()
    page.unroute("**/api/v1/manifest")
    page.get_by_role("button", name="Try again").click()

    page.locator("#start").wait_for()
    page.locator("#again").wait_for(state="hidden")


def test_a_network_that_asks_for_a_login_is_named(visitor: Visitor) -> None:
    page = visitor.page
    page.route("**/api/v1/manifest", lambda route: route.fulfill(body="<html>Please log in"))
    page.goto(f"{visitor.server}/measure/")

    page.get_by_text("Does this network ask you to log in?").wait_for()


def test_a_server_that_never_answers_is_named(visitor: Visitor, tmp_path: Path) -> None:
    server_js = tmp_path / "web" / "server.js"
    text = server_js.read_text(encoding="utf-8")
    assert "const MANIFEST_MS = 15_000;" in text
    server_js.write_text(text.replace("MANIFEST_MS = 15_000", "MANIFEST_MS = 500"), encoding="utf-8")
    page = visitor.page
    page.route("**/api/v1/manifest", lambda _: None)
    page.goto(f"{visitor.server}/measure/")

    page.get_by_text("It did not answer in time: load this page again.").wait_for()


def test_a_worker_that_never_answers_is_given_up_and_named(visitor: Visitor, tmp_path: Path) -> None:
    page_js, worker = tmp_path / "web" / "page.js", tmp_path / "web" / "worker.js"
    text = page_js.read_text(encoding="utf-8")
    assert "const FRAME_MS = 180_000;" in text
    page_js.write_text(text.replace("FRAME_MS = 180_000", "FRAME_MS = 1000"), encoding="utf-8")
    worker.write_text("", encoding="utf-8")
    page = begin(visitor)

    page.get_by_text("The device stopped answering").wait_for()
    assert page.get_by_text("Finished runs are kept.").count() == 0  # there are none
    assert_counted("began", "failed no_answer", "opened")
