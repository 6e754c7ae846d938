"""The product in one walk: explore, prepare and publish by clicking, measure with a phone, see the figure."""

import json
from pathlib import Path
from typing import Any

from crowd.explorations.measuring.reference_devices import create_this_machine
from crowd.explorations.models import Exploration
from crowd.fronts import manifests, sequences
from crowd.fronts.content import plans
from crowd.fronts.models import FrontVersion
from crowd.results.models import MeasurementSession
from tests.browser.test_publishing_in_a_browser import LogIn, log_in
from tests.browser.visitor import Visitor
from tests.slam.tiny import write_tiny_pack
from tests.waiting import until

__all__ = ["log_in"]

# Whatever is drawn from it follows the camera, in a moment.
SPACE = {
    "name": "kfusion",
    "parameters": [
        {"name": "volume_resolution", "type": "ordinal", "values": [64], "default": 64},
        {"name": "mu", "type": "ordinal", "values": [0.2], "default": 0.2},
        {"name": "compute_size_ratio", "type": "ordinal", "values": [1, 2], "default": 1},
        {"name": "pyramid_iterations_fine", "type": "ordinal", "values": [4, 6, 8, 10], "default": 10},
    ],
}


def test_what_an_administrator_publishes_by_clicking_a_phone_measures_at_once(
    chromium: Any, live_server: Any, log_in: LogIn, own_data_folder: Path, settings: Any, tmp_path: Path
) -> None:
    write_tiny_pack(own_data_folder / "sequences")
    settings.FRONTRUNNER_EVALUATOR = "tests.services.processor_time.measure"
    settings.FRONTRUNNER_SEQUENCES = [own_data_folder / "sequences"]
    for cache in (sequences.open_pack, plans._build, plans._plans_of_fronts, manifests._build):
        cache.cache_clear()
    space = tmp_path / "space.json"
    space.write_text(json.dumps(SPACE))
    create_this_machine()
    editor = log_in("editor")

    page = editor.open("/admin/explorations/exploration/add/")
    page.get_by_label("Space from a file").set_input_files(space)
    page.get_by_label("Method").select_option("random")
    page.get_by_label("Budget").fill("2")
    page.get_by_label("Points").fill("2")
    page.get_by_label("Repeats").fill("2")
    page.get_by_role("button", name="Create and start").click()
    page.get_by_role("link", name="Choose points to publish").click()
    until(Exploration.objects.filter(state="done").exists)
    page.get_by_role("button", name="Make a draft front").click()
    page.get_by_role("button", name="Prepare").click()
    page.get_by_text("Front kfusion-1 is being prepared").wait_for()
    page.get_by_role("button", name="Submit for review").click()
    page.get_by_text("its content is fixed now").wait_for()

    publisher = log_in("publisher")
    page = publisher.open("/admin/fronts/frontversion/")
    page.get_by_role("link", name="kfusion-1").click()
    page.get_by_role("button", name="Publish").click()
    publisher.shows("Phones and other browsers can measure, too, from then on.")
    page.get_by_role("button", name="Publish now").click()
    page.get_by_text("clients measure it now").wait_for()
    front = FrontVersion.objects.get()
    assert all(point.band and point.trajectory_sha256 for point in front.content.every)

    phone = Visitor(chromium, live_server.url, width=390)
    page = phone.open("/measure/")
    page.locator("#start").click()
    page.locator("#result[data-state]").wait_for()
    until(MeasurementSession.objects.exists)  # the page shows the result before it has sent it
    page.locator("#result:not([data-state=kept])").wait_for()
    session = MeasurementSession.objects.get()
    assert (session.front, session.runs.filter(status="ok").count()) == (front, 8)
    page = phone.open("/")
    page.get_by_role("table").get_by_text("Linux PC, SwiftShader").wait_for()
    assert editor.complaints == publisher.complaints == phone.complaints == []
    phone.context.close()
