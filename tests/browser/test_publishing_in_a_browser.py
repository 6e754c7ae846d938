"""An administrator's way in a real browser: from an empty form to what clients measure."""

import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from django.contrib.auth.models import Group, User
from django.test import Client

from crowd.audit.models import AuditEntry
from crowd.explorations.measuring.measurement import Measurement
from crowd.explorations.measuring.reference_devices import create_this_machine
from crowd.explorations.models import Evaluation, Exploration
from crowd.fronts.publishing import services
from tests.browser.visitor import Visitor, all_answered
from tests.builders.documents import front_document
from tests.builders.explorations import measured_on
from tests.slam.tiny import write_tiny_pack
from tests.waiting import until

PASSWORD = "a long enough password"
LogIn = Callable[..., Visitor]


def measure(evaluation: Evaluation, heartbeat: Callable[[], bool]) -> Measurement:
    """In place of SLAM: what some machine might measure."""
    return measured_on(evaluation)


@pytest.fixture
def log_in(chromium: Any, live_server: Any, transactional_db: None) -> Iterator[LogIn]:
    """Logs somebody with that role in through the form."""
    opened: list[Visitor] = []

    def visitor(role: str) -> Visitor:
        user = User.objects.create_user(f"{role}-1", password=PASSWORD, is_staff=True)
        user.groups.add(Group.objects.get(name=role))
        opened.append(Visitor(chromium, live_server.url))
        page = opened[-1].open("/admin/")
        page.get_by_label("Username").fill(user.username)
        page.get_by_label("Password").fill(PASSWORD)
        page.get_by_role("button", name="Log in").click()
        return opened[-1]

    with all_answered():
        yield visitor
        for one in opened:
            one.context.close()


def test_from_an_empty_form_to_what_clients_measure(
    log_in: LogIn, client: Client, own_data_folder: Path, settings: Any
) -> None:
    write_tiny_pack(own_data_folder / "sequences")
    settings.FRONTRUNNER_EVALUATOR = f"{__name__}.measure"
    create_this_machine()
    editor = log_in("editor")

    page = editor.open("/admin/explorations/exploration/add/")
    page.get_by_label("Method").select_option("random")
    page.get_by_label("Budget").fill("3")
    page.get_by_label("Points").fill("2")
    page.get_by_label("Repeats").fill("2")
    page.get_by_role("button", name="Create and start").click()
    exploration = until(Exploration.objects.filter(state="done").first)
    assert exploration.reference_device.name == "this-machine"

    page.get_by_role("link", name="Choose points to publish").click()
    for place, name in enumerate(("default", "best"), 1):
        until(lambda: page.get_by_label(f"Name of point {place}").input_value() == name)  # noqa: B023
    page.get_by_role("button", name="Make a draft front").click()
    page.get_by_role("button", name="Submit for review").click()
    page.get_by_text("is missing: prepare the draft").wait_for()
    page.get_by_role("button", name="Prepare").click()
    page.get_by_text("Front kfusion-1 is being prepared").wait_for()
    editor.shows("Prepared", "#preparation")
    page.get_by_role("button", name="Submit for review").click()
    editor.shows("its content is fixed now")
    page.get_by_role("button", name="Publish").wait_for(state="hidden")
    assert client.get("/api/v1/manifest").status_code == 404

    publisher = log_in("publisher")
    page = publisher.open("/admin/fronts/frontversion/")
    page.get_by_role("link", name="kfusion-1").click()
    page.get_by_role("link", name="What clients read").click()
    preview = page.locator("pre").text_content()
    page.go_back()
    page.get_by_label("For the log").fill("looks right")
    page.get_by_role("button", name="Publish").click()
    page.get_by_role("button", name="Publish now").wait_for()
    assert client.get("/api/v1/manifest").status_code == 404
    page.get_by_role("button", name="Publish now").click()
    page.get_by_text("clients measure it now").wait_for()

    manifest = client.get("/api/v1/manifest")
    assert manifest.json()["front_version"] == "kfusion-1"
    assert json.loads(preview) == manifest.json()
    assert AuditEntry.objects.filter(actor="publisher-1", action="published", note="looks right").exists()
    assert editor.complaints == publisher.complaints == []


def publish_two(pack: dict[str, Any], **changes: Any) -> None:
    """A front with all its points, and then one with the first two of them, which has `changes`."""
    better = front_document(pack, version="2", **changes)
    better["configurations"] = better["configurations"][:2]
    for document in (front_document(pack, version="1"), better):
        services.publish_content(document)


def test_an_earlier_version_is_published_again_after_a_look_at_the_difference(
    log_in: LogIn, client: Client, pack: dict[str, Any]
) -> None:
    publish_two(pack)
    publisher = log_in("publisher")

    page = publisher.open("/admin/fronts/frontversion/")
    page.get_by_role("link", name="kfusion-1").click()
    page.get_by_role("link", name="Compare").click()
    page.get_by_role("row", name=re.compile("^accurate gained")).wait_for()
    page.go_back()
    page.get_by_role("button", name="Publish again as a new version").click()
    page.get_by_role("row", name=re.compile("^accurate gained")).wait_for()
    page.get_by_role("button", name="Publish now").click()

    page.get_by_text("Front kfusion-3 is published").wait_for()
    assert client.get("/api/v1/manifest").json()["front_version"] == "kfusion-3"
    assert publisher.complaints == []


def test_a_version_is_compared_on_a_phone_without_scrolling_sideways(
    chromium: Any, live_server: Any, transactional_db: None, pack: dict[str, Any]
) -> None:
    publish_two(pack, provenance={"device": "another"})
    visitor = Visitor(chromium, live_server.url, width=390)

    page = visitor.open("/fronts/kfusion-1/")
    page.get_by_text("More: parameters").click()
    page.get_by_role("button", name="Compare").click()
    page.locator("figure[data-drawn]").first.wait_for()

    page.get_by_role("heading", name="Against kfusion-2").wait_for()
    page.get_by_text("What was gained, lost and changed").click()
    page.get_by_role("row", name=re.compile("^accurate gained")).wait_for()
    until(visitor.fits)
    assert visitor.complaints == []
    visitor.context.close()
