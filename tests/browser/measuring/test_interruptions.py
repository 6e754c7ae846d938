"""Networks, tabs and servers fail while a browser measures: no finished run is lost, each is sent once."""

import re
from typing import Any

from crowd.results.models import MeasurementSession, Run
from tests.browser.measuring.steps import arrived, assert_counted, begin, finished, go_on, held, hold_after
from tests.browser.visitor import Visitor

API = "/api/v1"
# The pause began tomorrow: the clock was set back since.
SET_BACK = """() => import("/measure/database.js").then(({ write }) => {
    const since = Date.now() + 24 * 3600 * 1000;
    return write("settings", "pause", { since, until: since + 3600 * 1000, tries: 1 });
})"""


def waiting(page: Any) -> Any:
    """The sessions in the list that the page tried to send, and keeps for the next try."""
    return page.locator("#sessions").get_by_text(re.compile(", kept here, not sent yet"))


def let_it_try_again(page: Any) -> None:
    """The time until the next try, which the page has kept by now, has passed."""
    page.evaluate('import("/measure/database.js").then(({ remove }) => remove("settings", "pause"))')


def test_a_cut_network_keeps_the_session_and_sends_it_once(visitor: Visitor) -> None:
    # A long pause: no second try before it is asked for.
    visitor.page.add_init_script("Math.random = () => 0.99")
    visitor.page.route("**/api/v1/submissions", lambda route: route.abort())
    page = begin(visitor)
    finished(page, "kept")
    page.get_by_text("sent as soon as the server can be reached").wait_for()
    assert MeasurementSession.objects.count() == 0

    waiting(page).wait_for()
    assert "network" not in page.locator("#sessions").inner_text()  # the sentence above says when it is sent
    visitor.page.unroute("**/api/v1/submissions")
    page.evaluate(SET_BACK)
    page.reload()
    arrived(page).wait_for()
    page.reload()
    arrived(page).wait_for()

    assert Run.objects.count() == 8
    assert MeasurementSession.objects.count() == 1


def test_without_a_network_the_page_opens_and_measures(webgpu_visitor: Visitor) -> None:
    visitor = webgpu_visitor
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
    hold_after(visitor, 2)
    page = begin(visitor)
    held(page)
    page.close()
    page = visitor.context.new_page()
    page.goto(f"{visitor.server}/measure/")
    page.get_by_role("button", name="Continue: 2 of 8 runs are done").click()
    finished(page)

    runs = Run.objects.order_by("order")
    assert [run.order for run in runs] == list(range(8))
    assert MeasurementSession.objects.count() == 1


def look(page: Any, state: str) -> None:
    """The page's tab is `hidden`, or `visible` again."""
    page.evaluate(
        """(value) => {
            Object.defineProperty(document, "visibilityState", { value, configurable: true });
            document.dispatchEvent(new Event("visibilitychange"));
        }""",
        state,
    )


def test_a_hidden_page_goes_on_by_itself_with_what_is_finished(visitor: Visitor) -> None:
    hold_after(visitor, 2)
    page = begin(visitor)
    held(page)
    look(page, "hidden")
    go_on(page)
    page.get_by_text("Paused: this page was hidden").wait_for()
    page.get_by_role("button", name="Continue: 2 of 8 runs are done").wait_for()
    assert_counted("began", "failed hidden", "opened")
    look(page, "visible")
    finished(page)

    assert [run.order for run in Run.objects.order_by("order")] == list(range(8))
    assert MeasurementSession.objects.count() == 1
    page.locator("#notice").wait_for(state="hidden")


def test_after_stop_the_page_says_what_is_kept_and_waits(visitor: Visitor) -> None:
    hold_after(visitor, 2)
    page = begin(visitor)
    held(page)
    page.get_by_role("button", name="Stop").click()
    go_on(page)

    page.get_by_text("Stopped: 2 of 8 runs are kept", exact=True).wait_for()
    page.get_by_role("button", name="Continue: 2 of 8 runs are done").wait_for()
    assert_counted("began", "failed stopped", "opened")
    look(page, "hidden")
    look(page, "visible")
    assert page.locator("#running").is_hidden()
    page.on("dialog", lambda dialog: dialog.accept())
    page.get_by_role("button", name="Erase everything").click()
    page.get_by_role("button", name="Agree and start").wait_for()


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


def test_two_tabs_do_not_measure_at_once(visitor: Visitor) -> None:
    hold_after(visitor, 1)
    page = begin(visitor)
    held(page)
    other = visitor.context.new_page()
    other.goto(f"{visitor.server}/measure/")
    other.locator("#start").click()

    other.get_by_text("Another tab is already measuring").wait_for()
    page.bring_to_front()
    go_on(page)
    finished(page)
    assert MeasurementSession.objects.count() == 1


def test_a_notice_goes_as_soon_as_the_server_can_be_reached(visitor: Visitor) -> None:
    page = visitor.page
    page.route("**/api/v1/manifest", lambda route: route.abort())
    page.goto(f"{visitor.server}/measure/")
    page.get_by_text("The server cannot be reached").wait_for()
    page.unroute("**/api/v1/manifest")
    page.evaluate("dispatchEvent(new Event('online'))")

    page.locator("#start").wait_for()
    page.locator("#notice").wait_for(state="hidden")
