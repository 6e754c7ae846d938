"""Someone measures a device by opening a link: what they see, and what arrives."""

import itertools
import json
import math
import re
from pathlib import Path
from typing import Any

import pytest
from django.test import Client

from crowd.dashboard import formats
from crowd.devices.models import DeviceDescription, Installation
from crowd.fronts.models import FrontVersion
from crowd.results.models import MeasurementSession, SessionSummary
from tests.browser.firefox import FirefoxPage
from tests.browser.measuring.steps import assert_counted, begin, finished, held, hold_after, widest_interval
from tests.browser.visitor import Visitor
from tests.client_kit.web.serving import measurement_at_any_speed
from tests.waiting import until

API = "/api/v1"


# Whatever the progress shows, in the order in which it shows it.
NOTE_PROGRESS = """addEventListener("DOMContentLoaded", () => {
    window.seen = [];
    const ids = ["running", "progress", "left"];
    const [running, progress, left] = ids.map((id) => document.getElementById(id));
    const note = () => window.seen.push([progress.value, left.textContent, document.title]);
    const changes = { subtree: true, attributes: true, childList: true };
    if (running) new MutationObserver(note).observe(running, changes);
})"""


def test_from_the_home_page_to_a_figure_on_it(webgpu_visitor: Visitor, client: Client) -> None:
    visitor = webgpu_visitor
    visitor.page.add_init_script(NOTE_PROGRESS)
    page = visitor.open("/")
    page.get_by_role("link", name="Measure this device", exact=True).first.click()
    page.locator("#agree").click()  # which says what the button means, and does nothing
    page.get_by_text("What is sent, with the values of this device").click()
    sample = json.loads(until(page.locator("#sample").inner_text))
    page.locator("#start").click()
    page.get_by_text(re.compile("^Run [0-9] of 8: the tuned version$")).wait_for()
    result = finished(page)

    assert_progress(page)
    speedup = float(result.get_attribute("data-speedup"))
    session = MeasurementSession.objects.get()
    rows = client.get(f"{API}/speedups").json()["results"]
    assert (session.backend, session.runs.filter(status="ok").count()) == ("webgpu", 8)
    assert [(row["backend"], row["state"]) for row in rows] == [("webgpu", "unconfirmed")]
    assert rows[0]["speedup"] == pytest.approx(speedup)
    assert rows[0]["session_low"] < speedup < rows[0]["session_high"]
    assert sample["device"] == DeviceDescription.objects.get().raw
    visitor.shows("unconfirmed", "#result")
    page.locator("#interval").wait_for()
    page.goto(f"{visitor.server}/")
    page.get_by_role("table").get_by_text("Linux PC, SwiftShader").wait_for()
    assert_counted("began", "finished", "opened")
    assert visitor.complaints == []


def assert_progress(page: Any) -> None:
    """The bar never went back, and said what was left."""
    until(lambda: re.match("[0-9.]+\N{MULTIPLICATION SIGN} · Measure this device", page.title()))
    seen = page.evaluate("window.seen")
    values = [value for value, _, _ in seen]
    assert values == sorted(values)
    assert any(0 < value < 0.2 for value in values)  # while the recording is downloaded
    assert 0.85 < values[-1] < 0.9  # the rest is for blocks that are measured again
    assert any(text.endswith(" left") for _, text, _ in seen)
    assert any(re.match("[1-9][0-9] % · Measure this device", title) for *_, title in seen)


def test_disturbed_blocks_are_measured_again_and_replaced(visitor: Visitor, tmp_path: Path) -> None:
    (tmp_path / "web" / "measurement.js").write_text(measurement_at_any_speed("0"), encoding="utf-8")
    page = begin(visitor)
    page.get_by_text(
        re.compile("^Second try, as another program used this device: run [1-4] of 4$")
    ).wait_for()
    finished(page)
    visitor.shows("The device was busy", "#result")

    session = MeasurementSession.objects.get()
    assert session.blocks_repeated == 2
    runs = session.runs.order_by("order")
    assert list(runs.values_list("order", flat=True)) == list(range(8, 16))
    assert sorted(runs.values_list("configuration__name", "repeat")) == [
        (name, repeat) for name in ("best", "default") for repeat in range(4)
    ]


@pytest.mark.parametrize("answer", ["async () => null", "() => new Promise(() => {})"])
def test_without_an_adapter_webassembly_measures(webgpu_visitor: Visitor, answer: str) -> None:
    webgpu_visitor.page.add_init_script(f"GPU.prototype.requestAdapter = {answer}")
    hold_after(webgpu_visitor, 1)
    page = begin(webgpu_visitor)
    held(page)

    sample = json.loads(page.locator("#sample").text_content())
    assert sample["sessions"][0]["backend"] == "wasm"
    assert_counted("began", "opened")


def test_without_webgpu_the_whole_way_goes_by_webassembly(visitor: Visitor, client: Client) -> None:
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
    assert session.backend == "wasm"
    assert session.threads in (1, 2, 4)
    assert session.extra["threads_claimed"] >= 1
    assert [run.status for run in session.runs.all()] == ["ok"] * 8
    assert session.stage_clock == "wall"
    rows = client.get(f"{API}/speedups").json()["results"]
    assert [(row["backend"], row["state"]) for row in rows] == [("wasm", "unconfirmed")]
    assert rows[0]["speedup"] == pytest.approx(speedup)


def test_the_whole_way_in_firefox(
    firefox: FirefoxPage, live_server: Any, front: FrontVersion, client: Client
) -> None:
    firefox.goto(f"{live_server.url}/measure/")
    assert firefox.wait_for("crossOriginIsolated")
    firefox.click("#asking:not([hidden]) #start:not(:disabled)")
    states = ("unconfirmed", "suspect", "invalid")
    shown = ", ".join(f"[data-state={state}]" for state in states)
    speedup = firefox.wait_for(f"document.querySelector('#result:is({shown})')?.dataset.speedup")

    assert_a_session_by_webassembly(client, float(speedup))


def test_one_button_is_consent_and_start_and_the_result_is_seen_again_and_shared(visitor: Visitor) -> None:
    page = visitor.open("/measure/")
    button = page.get_by_role("button", name="Agree and start")
    button.wait_for()

    box = button.bounding_box()
    assert box["y"] + box["height"] < 844
    assert Installation.objects.count() == 0
    button.click()
    speedup = finished(page).get_attribute("data-speedup")
    page.get_by_role("button", name="Measure again").wait_for()
    page.locator("#agree").wait_for(state="hidden")
    page.locator("#measure-probes").wait_for()
    until(lambda: page.evaluate("document.documentElement.scrollHeight") <= 2 * 844)
    page.get_by_text("What is sent, with the values of this device").click()
    page.locator("#agree").wait_for()

    page.add_init_script(
        "Object.defineProperty(navigator, 'share', { value: async (data) => { window.shared = data } })"
    )
    page.reload()
    page.get_by_role("button", name="Start", exact=True).wait_for()
    page.locator("#result").wait_for(state="hidden")
    page.locator("#sessions").get_by_role("button").click()
    result = finished(page)
    result.get_by_role("button", name="Share").click()

    page.locator("#interval").wait_for()
    assert result.get_attribute("data-speedup") == speedup
    shared = until(lambda: page.evaluate("window.shared"))
    assert shared["text"] == page.locator("#result-title").inner_text()
    assert re.fullmatch(f"{visitor.server}/devices/[^/]+/", shared["url"])


def test_of_a_wide_interval_the_range_alone_is_shown_shared_and_seen_again(
    visitor: Visitor, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    widest_interval(tmp_path, "0")
    monkeypatch.setattr("wire.session_statistics.WIDEST_INTERVAL", 0.0)
    visitor.page.add_init_script(
        "Object.defineProperty(navigator, 'share', { value: async (data) => { window.shared = data } })"
    )
    page = begin(visitor)
    result = finished(page)

    speedup = SessionSummary.objects.get(configuration__name="best")
    point = formats.speedup(math.exp(speedup.log_ratio))
    interval = page.locator("#speedup").inner_text()
    low, high = interval.removesuffix(formats.TIMES).split(formats.RANGE)
    assert 0 < float(low) < float(high)
    assert f"{low} to {high} times as fast" in page.locator("#result-title").inner_text()
    visitor.shows("The runs differ too much to give one number.", "#result")
    page.locator("#sessions").get_by_text(interval).wait_for()
    result.get_by_role("button", name="Share").click()
    shared = until(lambda: page.evaluate("window.shared"))
    assert shared["text"] == page.locator("#result-title").inner_text()
    assert visitor.fits()

    page.reload()
    page.locator("#sessions").get_by_role("button").click()
    finished(page)
    assert page.locator("#speedup").inner_text() == interval
    assert point not in page.locator("main").inner_text()
    page.get_by_role("link", name="Your private page").click()
    page.locator("h1", has_text="Your measurements").wait_for()
    assert interval in page.locator("main").inner_text()
    assert point not in page.locator("main").inner_text()


def test_a_session_that_does_not_count_shows_no_number_and_says_why(
    visitor: Visitor, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("crowd.results.validity.plausibility.plausible_range", lambda *_: (99.0, 100.0))
    page = begin(visitor)
    result = finished(page, "suspect")

    assert result.get_attribute("data-speedup") == ""
    assert page.locator("#speedup").inner_text() == ""
    visitor.shows("This measurement does not count", "#result")
    visitor.shows("It was sent, but is in no figure: ", "#result")
    assert "_" not in page.locator("#standing").inner_text()
    page.locator("#sessions").get_by_text("does not count").wait_for()


def test_an_owner_shows_the_model_exports_and_erases(visitor: Visitor) -> None:
    page = begin(visitor)
    finished(page)
    page.locator("#key summary").click()
    with page.expect_response("**/api/v1/me"):
        page.locator("#show-model").check()
    until(Installation.objects.filter(show_model=True).exists)

    with page.expect_download() as download:
        page.get_by_role("button", name="Export").click()
    exported = json.loads(download.value.path().read_text())
    assert len(exported["sessions"]) == 1
    assert exported["server"]

    asked: list[str] = []
    page.on("dialog", lambda dialog: (asked.append(dialog.message), dialog.accept()))
    page.get_by_role("button", name="Erase everything").click()
    page.locator("#mine").wait_for(state="hidden")
    page.get_by_text("Erased here and on the server").wait_for()
    assert "It cannot be undone." in asked[0]
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


def test_it_fits_and_is_accessible_at_every_width_in_every_theme(visitor: Visitor) -> None:
    page = visitor.open("/measure/")
    page.locator("#start").wait_for()
    barriers = {}
    for width, scheme in itertools.product((360, 1400, 390), ("light", "dark")):
        page.set_viewport_size({"width": width, "height": 844})
        page.emulate_media(color_scheme=scheme)
        until(visitor.fits, seen=lambda: page.evaluate("innerWidth"))
        if found := visitor.barriers():
            barriers[width, scheme] = found

    page.get_by_text("What is sent, with the values of this device").click()  # it scrolls in its own box
    page.get_by_text("The run, its time and its numbers are invented").wait_for()
    assert page.evaluate("document.documentElement.scrollWidth") == 390
    assert barriers == {}
    assert visitor.complaints == []


def test_in_german_it_fits_measures_and_opens_without_a_network(visitor: Visitor) -> None:
    page = visitor.page
    page.goto(f"{visitor.server}/measure/?language=de")
    page.get_by_role("button", name="Zustimmen und starten").wait_for()
    page.locator("#agree").wait_for()
    until(visitor.fits)
    page.locator("#start").click()
    result = finished(page)

    assert float(result.get_attribute("data-speedup")) > 0
    assert re.search(r"\d,\d+-mal so", result.inner_text())
    until(visitor.fits)
    until(lambda: page.evaluate("document.documentElement.scrollHeight") <= 2 * 844)
    page.locator("#sessions").get_by_text(re.compile(", gesendet$")).wait_for()
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
