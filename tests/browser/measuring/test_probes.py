"""After a session the page offers what the server assigns to this device, and measures it when asked to."""

import re
from typing import Any

import pytest
from django.test import Client

from crowd.predictions.models import ProbeAssignment
from crowd.predictions.probe_assignment import TEACHES
from crowd.results.models import MeasurementSession, Run
from tests.browser.measuring.conftest import PROBES
from tests.browser.measuring.steps import arrived, assert_counted, begin, finished, go_on, held, hold_after
from tests.browser.visitor import Visitor
from tests.waiting import until

ASSIGNED = re.compile(r"/api/v1/manifest\?application=kfusion&minutes=2$")
RECOMMENDATION = re.compile(r"/api/v1/recommendation\?application=kfusion$")
BEST_HERE = "Best on this device with at most 5 cm of error"
TIMES = "\N{MULTIPLICATION SIGN}"


@pytest.fixture
def asked(visitor: Visitor) -> list[str | None]:
    """The tokens with which the page asks what else to measure."""
    tokens: list[str | None] = []

    def noted(route: Any) -> None:
        tokens.append(route.request.headers.get("authorization"))
        route.continue_()

    visitor.page.route(ASSIGNED, noted)
    return tokens


def assigned() -> list[str]:
    """The names of what the server assigned: both probes of its front, in one order or the other."""
    names = list(ProbeAssignment.objects.order_by("id").values_list("configuration__name", flat=True))
    assert sorted(names) == sorted(PROBES)
    return names


def offered(page: Any) -> Any:
    """The button that measures what is assigned, as soon as it is there."""
    button = page.get_by_role("button", name="Measure 2 more")
    button.wait_for()
    return button


def assert_recommended(page: Any, best: str) -> None:
    """The line below the result says that `best`, a regular expression, is best on this device."""
    line = page.locator("#recommendation")
    until(lambda: re.match(f"{BEST_HERE}: {best}", line.inner_text()), seen=line.inner_text)


def configurations(session: MeasurementSession) -> list[str]:
    return list(session.runs.order_by("order").values_list("configuration__name", flat=True))


def test_who_presses_the_button_measures_what_is_assigned(visitor: Visitor, asked: list[str | None]) -> None:
    page = begin(visitor)
    speedup = finished(page).get_attribute("data-speedup")
    button = offered(page)
    rows = page.locator("#assigned li").all_text_contents()
    assert visitor.barriers() == []
    button.click()
    first, second = names = assigned()
    page.get_by_text(f"Thank you: predictions now include {first} and {second} on this device.").wait_for()

    assert rows == [f"{name}: {TEACHES}" for name in names]
    ordinary, probes = MeasurementSession.objects.order_by("id")
    assert len(configurations(ordinary)) == 8
    assert configurations(probes) == ["default", *names, *reversed(names), "default"]
    assert set(probes.runs.values_list("status", flat=True)) == {"ok"}
    assert page.locator("#result").get_attribute("data-speedup") == speedup
    page.locator("#probes").wait_for(state="hidden")
    # On a busy machine either may have been the faster one.
    assert_recommended(page, f"the (tuned version|default), [0-9.]+{TIMES} \\(measured\\)")
    assert page.locator("#recommendation").get_by_role("link").get_attribute("href") == "/recommend/"
    until(lambda: arrived(page).count() == 2)
    page.locator("#sessions").get_by_text("2 probes", exact=True).wait_for()
    assert len(asked) == 1
    assert (asked[0] or "").startswith("Bearer ")
    assert_counted("began", "finished", "opened")


def test_a_page_that_is_loaded_again_in_the_middle_sends_the_finished_runs(
    visitor: Visitor, asked: list[str | None]
) -> None:
    hold_after(visitor, 8 + 3)
    page = begin(visitor)
    finished(page)
    offered(page).click()
    held(page)
    page.reload()
    page.get_by_role("button", name="Start", exact=True).wait_for()
    arrived(page).nth(1).wait_for()

    first, second = assigned()
    assert configurations(MeasurementSession.objects.latest("id")) == ["default", first, second]
    assert Run.objects.count() == 8 + 3
    page.locator("#sessions").get_by_text("2 probes", exact=True).wait_for()


def test_another_tab_leaves_the_probes_in_progress_alone(visitor: Visitor, asked: list[str | None]) -> None:
    hold_after(visitor, 8 + 3)
    page = begin(visitor)
    finished(page)
    offered(page).click()
    held(page)
    other = visitor.context.new_page()
    other.goto(f"{visitor.server}/measure/")
    other.locator("#start").wait_for()
    page.bring_to_front()
    go_on(page)
    page.get_by_text("Thank you: predictions now include ").wait_for()

    assert [len(configurations(one)) for one in MeasurementSession.objects.order_by("id")] == [8, 6]


def test_where_nothing_is_assigned_nothing_is_offered_and_a_prediction_says_so(
    visitor: Visitor, client: Client
) -> None:
    manifest = client.get("/api/v1/manifest").json()
    best = {
        "configuration": "best",
        "predicted": {"ratio": 4.0, "low": 3.1, "high": 5.2},
        "state": "predicted",
    }
    visitor.page.route(ASSIGNED, lambda route: route.fulfill(json=manifest | {"assigned": []}))
    visitor.page.route(RECOMMENDATION, lambda route: route.fulfill(json=best))
    with visitor.page.expect_response(ASSIGNED):
        page = begin(visitor)
    finished(page)
    page.get_by_role("button", name="Measure again").wait_for()

    page.locator("#probes").wait_for(state="hidden")
    basis = f"predicted, 95 % interval 3.10{TIMES} to 5.20{TIMES}"
    assert_recommended(page, re.escape(f"the tuned version, 4.00{TIMES} ({basis}). "))
