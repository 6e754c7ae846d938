"""Someone measures a device by opening a link: what they see, what arrives, and what is never lost."""

import copy
import json
import math
import os
import re
import shutil
from pathlib import Path
from typing import Any

import pytest
from django.test import Client

from crowd.devices.models import AttemptCount, DeviceDescription, Installation
from crowd.fronts.models import FrontVersion
from crowd.fronts.publishing.services import publish_content
from crowd.results.models import MeasurementSession, Run
from tests.browser.firefox import FirefoxPage
from tests.browser.measuring.conftest import Published
from tests.browser.visitor import Visitor
from tests.client_kit.web.serving import WEB, measurement_at_any_speed
from tests.services.program import PATIENCE_SECONDS, until

API = "/api/v1"
# The pause began tomorrow: the clock was set back since.
SET_BACK = """() => import("/measure/database.js").then(({ write }) => {
    const since = Date.now() + 24 * 3600 * 1000;
    return write("settings", "pause", { since, until: since + 3600 * 1000, tries: 1 });
})"""


@pytest.fixture(autouse=True)
def any_speed(monkeypatch: pytest.MonkeyPatch, settings: Any, tmp_path: Path) -> None:
    """How fast and how evenly a busy machine computes decides nothing here."""
    settings.FRONTRUNNER_WEB_CLIENT = shutil.copytree(WEB, tmp_path / "web")
    (tmp_path / "web" / "measurement.js").write_text(measurement_at_any_speed(), encoding="utf-8")
    monkeypatch.setattr("frontrunner.session_statistics.LEAST_DEVIATION", math.inf)
    monkeypatch.setattr("crowd.predictions.probe_assignment.MAX_DRIFT", math.inf)
    monkeypatch.setattr(
        "crowd.results.validity.plausibility.plausible_range", lambda *_: (-math.inf, math.inf)
    )


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


def test_from_the_home_page_to_a_figure_on_it(visitor: Visitor, client: Client) -> None:
    page = visitor.open("/")
    page.get_by_role("link", name="Measure this device", exact=True).first.click()
    page.locator("#agree").click()  # which says what the button means, and does nothing
    page.get_by_text("What is sent, with the values of this device").click()
    sample = json.loads(page.locator("#sample").inner_text())
    page.locator("#start").click()
    page.get_by_text(re.compile("^Run [0-9] of 8: the tuned version$")).wait_for()
    result = finished(page)

    speedup = float(result.get_attribute("data-speedup"))
    session = MeasurementSession.objects.get()
    rows = client.get(f"{API}/speedups").json()["results"]
    assert (session.backend, session.runs.filter(status="ok").count()) == ("webgpu", 8)
    assert [(row["backend"], row["state"]) for row in rows] == [("webgpu", "unconfirmed")]
    assert rows[0]["speedup"] == pytest.approx(speedup)
    assert rows[0]["session_low"] < speedup < rows[0]["session_high"]
    assert sample["device"] == DeviceDescription.objects.get().raw
    assert "unconfirmed" in result.inner_text()
    page.goto(f"{visitor.server}/")
    assert page.get_by_role("table").get_by_text("Linux PC, SwiftShader").is_visible()
    assert_counted("began", "finished", "opened")
    assert visitor.complaints == []


def test_disturbed_blocks_are_measured_again_and_replaced(visitor: Visitor, tmp_path: Path) -> None:
    (tmp_path / "web" / "measurement.js").write_text(measurement_at_any_speed("0"), encoding="utf-8")
    page = begin(visitor)
    page.get_by_text("Another program used this device while we measured. Measuring again.").wait_for()
    finished(page)

    session = MeasurementSession.objects.get()
    assert session.blocks_repeated == 2
    runs = session.runs.order_by("order")
    assert list(runs.values_list("order", flat=True)) == list(range(8, 16))
    assert sorted(runs.values_list("configuration__name", "repeat")) == [
        (name, repeat) for name in ("best", "default") for repeat in range(4)
    ]


def test_a_cut_network_keeps_the_session_and_sends_it_once(visitor: Visitor) -> None:
    visitor.page.add_init_script(
        "Math.random = () => 0.99"
    )  # a long pause: no second try before it is asked for
    visitor.page.route("**/api/v1/submissions", lambda route: route.abort())
    page = begin(visitor)
    finished(page, "kept")
    assert page.get_by_text("sent as soon as the server can be reached").is_visible()
    assert MeasurementSession.objects.count() == 0

    waiting(page).wait_for()
    visitor.page.unroute("**/api/v1/submissions")
    page.evaluate(SET_BACK)
    page.reload()
    arrived(page).wait_for()
    page.reload()
    arrived(page).wait_for()

    assert Run.objects.count() == 8
    assert MeasurementSession.objects.count() == 1


def waiting(page: Any) -> Any:
    """The sessions in the list that the page tried to send, and keeps for the next try."""
    return page.locator("#sessions").get_by_text(re.compile(", kept here, not sent yet"))


def let_it_try_again(page: Any) -> None:
    """The time until the next try, which the page has kept by now, has passed."""
    page.evaluate('import("/measure/database.js").then(({ remove }) => remove("settings", "pause"))')


def test_without_a_network_the_page_opens_and_measures(visitor: Visitor) -> None:
    page = begin(visitor)
    finished(page)
    page.evaluate("navigator.serviceWorker.ready.then(() => undefined)")
    page.reload()  # this time under the service worker
    page.locator("#start").wait_for()
    visitor.context.set_offline(True)

    page.reload()
    page.get_by_role("button", name="Start").click()
    finished(page, "kept")
    waiting(page).wait_for()
    visitor.context.set_offline(False)  # the browser says that it is online
    arrived(page).nth(1).wait_for()
    finished(page)  # the result has the server's answer now

    assert MeasurementSession.objects.count() == 2


def test_a_tab_killed_after_the_second_run_goes_on_in_the_next(visitor: Visitor) -> None:
    page = begin(visitor)
    page.get_by_text(re.compile("^Run [3-6] of 8")).wait_for()
    page.close()
    page = visitor.context.new_page()
    page.set_default_timeout(PATIENCE_SECONDS * 1000)
    page.goto(f"{visitor.server}/measure/")
    page.get_by_role("button", name=re.compile("^Continue: [2-7] of 8 runs are done$")).click()
    finished(page)

    runs = Run.objects.order_by("order")
    assert [run.order for run in runs] == list(range(8))
    assert MeasurementSession.objects.count() == 1


def test_a_hidden_page_stops_and_keeps_what_is_finished(visitor: Visitor) -> None:
    page = begin(visitor)
    page.get_by_text(re.compile("^Run [2-6] of 8")).wait_for()
    page.evaluate(
        """() => {
            Object.defineProperty(document, "visibilityState", { value: "hidden", configurable: true });
            document.dispatchEvent(new Event("visibilitychange"));
        }"""
    )

    page.get_by_text("The measurement was interrupted").wait_for()
    page.get_by_role("button", name=re.compile("^Continue: [1-7] of 8 runs are done$")).wait_for()
    assert_counted("began", "failed hidden", "opened")


def test_the_same_bytes_are_sent_again_after_503(visitor: Visitor) -> None:
    sent: list[tuple[str | None, bytes | None]] = []

    def answer(route: Any) -> None:
        sent.append((route.request.headers["idempotency-key"], route.request.post_data_buffer))
        if len(sent) == 1:
            route.fulfill(status=503, headers={"Retry-After": "600"}, body="{}")
        else:
            route.continue_()

    visitor.page.route("**/api/v1/submissions", answer)
    page = begin(visitor)
    finished(page, "kept")
    waiting(page).wait_for()
    page.evaluate("document.querySelector('#sessions li').id = 'listed'; dispatchEvent(new Event('online'))")
    page.locator("#listed").wait_for(state="detached")  # the list is new: it is too early
    assert len(sent) == 1
    let_it_try_again(page)
    page.reload()
    arrived(page).wait_for()

    assert len(sent) == 2
    assert len(set(sent)) == 1
    assert MeasurementSession.objects.count() == 1


def test_a_session_that_the_server_cannot_take_holds_up_no_other(visitor: Visitor) -> None:
    page = visitor.open("/fronts/")  # no service worker takes requests from here
    keys: list[str | None] = []

    def answer(route: Any) -> None:
        keys.append(route.request.headers["idempotency-key"])
        if keys[-1] == "old":
            route.fulfill(status=500, body="{}")
        else:
            route.fulfill(status=202, json={"submission_id": 1, "items": [{"status": "accepted"}]})

    page.route("**/api/v1/enrol", lambda route: route.fulfill(json={"installation_id": "1", "token": "t"}))
    page.route("**/api/v1/submissions", answer)
    sent = send_twice(page, "old", "new")

    assert keys == ["old", "new"]
    assert sent["states"] == ["accepted", "queued"]
    assert 0 < sent["wait"] <= 30_000


def test_a_refusal_to_enrol_rejects_no_session(visitor: Visitor) -> None:
    page = visitor.open("/fronts/")
    page.route("**/api/v1/enrol", lambda route: route.fulfill(status=400, body="{}"))

    sent = send_twice(page, "old", "new")

    assert sent["states"] == ["queued", "queued"]
    assert 0 < sent["wait"] <= 30_000


def send_twice(page: Any, *keys: str) -> Any:
    """Queue a session for each of `keys`, send twice; the states, newest first, and the time to wait (ms)."""
    return page.evaluate(
        """async (keys) => {
            const { sendAll } = await import("/measure/delivery.js");
            const sessions = await import("/measure/sessions.js");
            for (const [number, key] of keys.entries())
                await sessions.keep({
                    id: key, key, startedAt: `2026-01-0${number + 1}T00:00:00Z`, state: "queued",
                    manifest: { consent_version: 2 }, runs: [], body: "{}", reason: "",
                });
            const pauses = [await sendAll(), await sendAll()];
            const kept = await sessions.all();
            return { states: kept.map(({ state }) => state), wait: Math.max(...pauses) };
        }""",
        keys,
    )


def test_a_shader_that_is_not_what_its_digest_says_is_refused(visitor: Visitor) -> None:
    visitor.page.route(
        "**/shaders/*", lambda route: route.fulfill(body="{}", content_type="application/json")
    )
    page = begin(visitor)

    page.get_by_text("is damaged: its SHA-256 differs").wait_for()
    assert MeasurementSession.objects.count() == 0


def test_a_device_that_computes_wrong_results_is_stopped_before_anything_is_timed(
    visitor: Visitor, published: Published
) -> None:
    narrow = copy.deepcopy(published.document) | {"version": "narrow"}
    narrow["configurations"][1]["band"] = 1e-9
    publish_content(narrow)
    page = begin(visitor)

    page.get_by_text("This device computes wrong results").wait_for()
    assert page.get_by_text("the band is 1e-9 m").is_visible()
    [counted] = until(lambda: AttemptCount.objects.filter(reason="wrong_results"), 30)
    assert (counted.step, counted.gpu_architecture, counted.browser) == ("failed", "swiftshader", "Chrome")
    assert MeasurementSession.objects.count() == Installation.objects.count() == 0


@pytest.mark.parametrize(
    "script", ["delete Navigator.prototype.gpu", "GPU.prototype.requestAdapter = async () => null"]
)
def test_without_webgpu_the_whole_way_goes_by_webassembly(
    visitor: Visitor, client: Client, script: str
) -> None:
    visitor.page.add_init_script(script)
    page = begin(visitor)
    sample = json.loads(page.locator("#sample").text_content())
    result = finished(page)

    assert_a_session_by_webassembly(client, float(result.get_attribute("data-speedup")))
    assert sample["device"] == DeviceDescription.objects.get().raw
    assert sample["sessions"][0]["backend"] == "wasm"
    assert_counted("began", "finished", "opened")
    assert visitor.complaints == []


def assert_a_session_by_webassembly(client: Client, speedup: float) -> None:
    """The one session, as the server has it and shows it."""
    session = MeasurementSession.objects.get()
    assert (session.backend, session.threads) == ("wasm", min(os.cpu_count() or 1, 4))
    assert [run.status for run in session.runs.all()] == ["ok"] * 8
    assert session.stage_clock == "wall"
    rows = client.get(f"{API}/speedups").json()["results"]
    assert [(row["backend"], row["state"]) for row in rows] == [("wasm", "unconfirmed")]
    assert rows[0]["speedup"] == pytest.approx(speedup)


def test_the_whole_way_in_firefox(
    firefox: FirefoxPage, live_server: Any, front: FrontVersion, client: Client
) -> None:
    firefox.goto(f"{live_server.url}/measure/")
    assert firefox.wait_for("crossOriginIsolated", PATIENCE_SECONDS)
    firefox.click("#asking:not([hidden]) #start:not(:disabled)", PATIENCE_SECONDS)
    states = ("unconfirmed", "suspect", "invalid")
    shown = ", ".join(f"[data-state={state}]" for state in states)
    speedup = firefox.wait_for(
        f"document.querySelector('#result:is({shown})')?.dataset.speedup", PATIENCE_SECONDS
    )

    assert_a_session_by_webassembly(client, float(speedup))


def test_a_browser_that_cannot_measure_says_why(visitor: Visitor) -> None:
    visitor.page.add_init_script("delete Navigator.prototype.gpu; WebAssembly.validate = () => false")
    page = visitor.open("/measure/")

    page.get_by_text("This browser is too old to measure").wait_for()
    page.get_by_role("link", name="Browsers that can measure").wait_for()
    assert page.locator("#start").is_hidden()
    assert_counted("unsupported no_wasm_simd")


def test_an_address_without_https_says_so_and_shows_no_qr_code(visitor: Visitor, settings: Any) -> None:
    settings.ALLOWED_HOSTS = ["*"]
    insecure = visitor.server.replace("localhost", "lab.test").replace("127.0.0.1", "lab.test")
    page = visitor.page
    page.goto(f"{insecure}/measure/")

    page.get_by_text("This address has no HTTPS").wait_for()
    page.goto(f"{insecure}/")
    assert page.locator(".qr-code").count() == 0
    assert page.get_by_text("Without HTTPS, browsers measure only").is_visible()


def test_what_is_sent_scrolls_in_its_own_box_on_a_phone(visitor: Visitor) -> None:
    visitor.page.set_viewport_size({"width": 390, "height": 844})
    page = visitor.open("/measure/")
    page.get_by_text("What is sent, with the values of this device").click()

    page.get_by_text("The run, its time and its numbers are invented").wait_for()
    assert page.evaluate("document.documentElement.scrollWidth") == 390


def test_one_button_on_the_first_screen_is_consent_and_start(visitor: Visitor) -> None:
    visitor.page.set_viewport_size({"width": 390, "height": 844})
    page = visitor.open("/measure/")
    button = page.get_by_role("button", name="Agree and start")
    button.wait_for()

    box = button.bounding_box()
    assert box["y"] + box["height"] < 844
    assert Installation.objects.count() == 0
    button.click()
    finished(page)
    page.reload()
    page.get_by_role("button", name="Start", exact=True).wait_for()


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
        ("Object.defineProperty(navigator, 'locks', { value: undefined })", "This browser is too old"),
    ],
)
def test_what_a_browser_lacks_is_said(visitor: Visitor, script: str, words: str) -> None:
    visitor.page.add_init_script(script)
    page = visitor.page
    page.goto(f"{visitor.server}/measure/")

    page.get_by_text(words).wait_for()
    assert page.get_by_text("Checking this browser").is_hidden()
    assert page.locator("#start").is_hidden()


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


def test_an_adapter_that_never_answers_is_left_alone(visitor: Visitor) -> None:
    visitor.page.add_init_script("GPU.prototype.requestAdapter = () => new Promise(() => {})")
    page = begin(visitor)

    finished(page)
    assert MeasurementSession.objects.get().backend == "wasm"


def test_the_bar_never_goes_back_and_says_what_is_left(visitor: Visitor) -> None:
    page = visitor.page
    page.add_init_script(
        """addEventListener("DOMContentLoaded", () => {
            window.seen = [];
            const ids = ["running", "progress", "left"];
            const [running, progress, left] = ids.map((id) => document.getElementById(id));
            new MutationObserver(() => window.seen.push([progress.value, left.textContent]))
                .observe(running, { subtree: true, attributes: true, childList: true });
        })"""
    )
    begin(visitor)
    finished(page)
    seen = page.evaluate("window.seen")

    values = [value for value, _ in seen]
    assert values == sorted(values)
    assert values[-1] == 1
    assert any(text.endswith(" left") for _, text in seen)


def test_a_session_that_does_not_count_shows_no_number_and_says_why(
    visitor: Visitor, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("crowd.results.validity.plausibility.plausible_range", lambda *_: (99.0, 100.0))
    page = begin(visitor)
    result = finished(page, "suspect")

    assert result.get_attribute("data-speedup") == ""
    assert page.locator("#speedup").inner_text() == ""
    assert "This measurement does not count" in result.inner_text()
    assert "It was sent, but is in no figure: " in result.inner_text()
    assert "_" not in page.locator("#standing").inner_text()
    page.locator("#sessions").get_by_text("does not count").wait_for()


def test_an_owner_shows_the_model_exports_and_erases(visitor: Visitor) -> None:
    page = begin(visitor)
    finished(page)
    with page.expect_response("**/api/v1/me"):
        page.locator("#show-model").check()
    assert Installation.objects.get().show_model

    with page.expect_download() as download:
        page.get_by_role("button", name="Export").click()
    exported = json.loads(download.value.path().read_text())
    assert len(exported["sessions"]) == 1
    assert exported["server"]

    page.on("dialog", lambda dialog: dialog.accept())
    page.get_by_role("button", name="Erase everything").click()
    page.locator("#mine").wait_for(state="hidden")
    assert MeasurementSession.objects.count() == Installation.objects.count() == 0


def test_the_kept_key_exports_and_erases_in_another_browser_and_is_sent_to_nobody(
    visitor: Visitor, chromium: Any
) -> None:
    page = begin(visitor)
    finished(page)
    page.locator("#key summary").click()
    link = page.locator("#key-link").evaluate("(link) => link.href")
    with page.expect_download() as download:
        page.get_by_role("button", name="Save it as a file").click()
    assert link in download.value.path().read_text()

    other = Visitor(chromium, visitor.server, width=390)
    token = link.partition("#")[2]
    sent: list[str] = []
    other.page.on(
        "request", lambda one: sent.append(one.url.partition("#")[0] + one.headers.get("referer", ""))
    )
    other.page.goto(link)
    with other.page.expect_download() as download:
        other.page.get_by_role("button", name="Export").click()
    assert str(MeasurementSession.objects.get().uuid) in download.value.path().read_text()
    other.page.once("dialog", lambda dialog: dialog.dismiss())
    other.page.get_by_role("button", name="Erase everything").click()
    assert Installation.objects.count() == 1
    other.page.once("dialog", lambda dialog: dialog.accept())
    other.page.get_by_role("button", name="Erase everything").click()
    other.page.get_by_text("Erased.").wait_for()

    assert MeasurementSession.objects.count() == Installation.objects.count() == 0
    assert sent
    assert not [address for address in sent if token in address]
    assert other.complaints == []
    other.page.reload()
    other.page.get_by_text("Nothing is stored under this key").wait_for()
    other.context.close()


def test_a_notice_goes_as_soon_as_the_server_can_be_reached(visitor: Visitor) -> None:
    page = visitor.page
    page.route("**/api/v1/manifest", lambda route: route.abort())
    page.goto(f"{visitor.server}/measure/")
    page.get_by_text("The server cannot be reached").wait_for()
    page.unroute("**/api/v1/manifest")
    page.evaluate("dispatchEvent(new Event('online'))")

    page.locator("#start").wait_for()
    assert page.locator("#notice").is_hidden()


def test_two_tabs_do_not_measure_at_once(visitor: Visitor) -> None:
    page = begin(visitor)
    page.get_by_text(re.compile("^Checking what")).wait_for()
    other = visitor.context.new_page()
    other.goto(f"{visitor.server}/measure/")
    other.locator("#start").click()

    other.get_by_text("Another tab is already measuring").wait_for()
    page.bring_to_front()
    finished(page)
    assert MeasurementSession.objects.count() == 1


@pytest.mark.parametrize("width", [360, 390, 1400])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_it_fits_and_is_accessible(visitor: Visitor, width: int, scheme: Any) -> None:
    from axe_playwright_python.sync_playwright import Axe

    visitor.page.set_viewport_size({"width": width, "height": 844})
    visitor.page.emulate_media(color_scheme=scheme)
    page = visitor.open("/measure/")
    page.locator("#start").wait_for()

    assert page.evaluate("document.documentElement.scrollWidth") <= width
    found = Axe().run(page, options={"resultTypes": ["violations"]}).response["violations"]
    assert [rule["id"] for rule in found if rule["impact"] in {"serious", "critical"}] == []
    assert visitor.complaints == []


def test_in_german_it_fits_measures_and_opens_without_a_network(visitor: Visitor) -> None:
    page = visitor.page
    page.goto(f"{visitor.server}/measure/?language=de")
    page.get_by_role("button", name="Zustimmen und starten").wait_for()
    assert page.locator("#agree").is_visible()
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    page.locator("#start").click()
    result = finished(page)

    assert float(result.get_attribute("data-speedup")) > 0
    assert re.search(r"\d,\d+-mal so", result.inner_text())
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    assert page.locator("#sessions").get_by_text(re.compile(", gesendet$")).count() == 1
    page.evaluate("navigator.serviceWorker.ready.then(() => undefined)")
    page.goto(f"{visitor.server}/measure/?language=fr")  # under the service worker
    page.locator("#start").wait_for()
    page.goto(f"{visitor.server}/measure/?language=de")
    page.locator("#start").wait_for()
    assert visitor.complaints == []
    visitor.context.set_offline(True)
    for language, word in (("fr", "Commencer"), ("de", "Starten")):
        page.goto(f"{visitor.server}/measure/?language={language}")
        page.get_by_role("button", name=word, exact=True).wait_for()
    visitor.context.set_offline(False)


def test_a_worker_that_never_answers_is_given_up_and_named(visitor: Visitor, tmp_path: Path) -> None:
    page_js, worker = tmp_path / "web" / "page.js", tmp_path / "web" / "worker.js"
    text = page_js.read_text(encoding="utf-8")
    assert "const FRAME_MS = 180_000;" in text
    page_js.write_text(text.replace("FRAME_MS = 180_000", "FRAME_MS = 1000"), encoding="utf-8")
    worker.write_text("", encoding="utf-8")
    page = begin(visitor)

    page.get_by_text("The device stopped answering").wait_for()
    assert page.get_by_text("Finished runs are kept.").is_visible()
    assert_counted("began", "failed no_answer", "opened")
