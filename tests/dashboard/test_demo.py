"""A demo server says so on every page and in every download, and takes no measurements; no other does."""

import re
from pathlib import Path
from typing import Any

import pytest
from django.test import Client
from django.urls import reverse

from crowd.dashboard.content.citation import SIMULATED
from crowd.dashboard.drawings import DRAWINGS
from crowd.dashboard.views import cards
from crowd.explorations.models import Exploration
from crowd.fronts.models import FrontVersion
from crowd.operations import first_run
from crowd.results.models import Run
from crowd.results.opendata import exports
from crowd.results.opendata.description_files import DATA_PACKAGE, LICENCE_FILE
from crowd.results.reading import selectors
from crowd.results.reading.queries.filters import SpeedupFilters
from tests.browser.reading import site
from tests.builders.participant import API
from tests.crowd.operations.test_limits import ENROLMENT

BANNER = "These devices do not exist: all figures are simulated."
# Its figures come with Frontrunner.
MEASURED = "/surface/"
LISTS = ("/speedups", "/devices", "/sessions", "/runs")


@pytest.fixture
def pages(db: None, own_data_folder: Path, settings: Any) -> dict[str, str]:
    """A filled server's pages."""
    settings.FRONTRUNNER_PAGES_PER_MINUTE = settings.FRONTRUNNER_READS_PER_MINUTE = 0
    return site.fill(own_data_folder)


def downloads(client: Client) -> dict[str, tuple[str, str]]:
    """The name and the text of every file that figures, searches and the open data give, by address."""
    run = Run.objects.first()
    assert run is not None
    values = {"slug": "google-pixel-8", "uuid": run.session.uuid, "key": Exploration.objects.get().pk}
    values |= {"objective": "runtime", "by": "vendor"}
    addresses = [f"/explorations/{values['key']}/evaluations.{kind}" for kind in ("csv", "json")]
    for drawing in DRAWINGS:
        mine = values | {"slug": "kfusion-test"} if drawing.name.startswith("front") else values
        mine = mine | {"uuid": run.uuid} if drawing.name.startswith("run") else mine
        needed = {name: mine[name] for name in re.findall(r"<\w+:(\w+)>", drawing.path)}
        query = "?device=google-pixel-8&configurations=default,best" if drawing.name == "compare" else ""
        addresses += [
            reverse(f"dashboard:{drawing.name}-{kind}", kwargs=needed) + query
            for kind in ("csv", "json", "tex")
        ]
    export = client.get(f"{API}/exports").json()["results"][0]
    addresses += [file["url"] for file in export["files"]]
    contents = {}
    for address in addresses:
        response = client.get(address)
        assert response.status_code == 200, address
        contents[address] = (response.get("Content-Disposition", ""), response.getvalue().decode("latin-1"))
    return contents


def test_every_page_and_download_of_a_demo_server_says_so(
    client: Client, pages: dict[str, str], demo: None
) -> None:
    exports.create_export()  # the earlier one was written before the server was a demo
    for name, address in pages.items():
        page = client.get(address, follow=True).content.decode()
        assert (BANNER in page) == (MEASURED not in address), name
    assert "are\n  not simulated" in client.get(MEASURED).content.decode()
    assert BANNER in client.get("/admin/login/").content.decode()
    assert BANNER in client.get("/embed/speedups/").content.decode()
    assert SIMULATED in client.get("/figures/speedups.json?save=column").content.decode()
    assert cards.of_crowd(selectors.speedups(SpeedupFilters())).note.startswith(SIMULATED)
    for address, (name, text) in downloads(client).items():
        simulated = MEASURED not in address
        assert bool(re.search(r"-simulated[.\"]", name)) == simulated, address
        if address.startswith("/tables/") and address.partition("?")[0].endswith(".json"):
            assert f'"simulated": {str(simulated).lower()}' in text, address
    for word in (DATA_PACKAGE, LICENCE_FILE):
        assert "simulated" in client.get(f"/data/latest/{word}").getvalue().decode()
    for path in LISTS:
        rows = client.get(f"{API}{path}").json()["results"]
        assert rows
        assert all(row.get("simulated", True) is True for row in rows)
        assert client.get(f"{API}{path}?simulated=1").json()["results"] == rows
        assert client.get(f"{API}{path}?simulated=0").json()["results"] == []


@pytest.mark.slow
def test_no_page_or_download_of_another_server_does(client: Client, pages: dict[str, str]) -> None:
    for name, address in pages.items():
        assert BANNER not in client.get(address, follow=True).content.decode(), name
    for address, (name, text) in downloads(client).items():
        assert "imulated" not in name, address
        assert '"simulated": true' not in text, address
    for path in LISTS:
        rows = client.get(f"{API}{path}").json()["results"]
        assert all(row.get("simulated", False) is False for row in rows)
        assert client.get(f"{API}{path}?simulated=1").json()["results"] == []
        assert client.get(f"{API}{path}?simulated=0").json()["results"] == rows


def test_a_demo_server_refuses_real_clients_before_they_measure(
    client: Client, front: FrontVersion, demo: None
) -> None:
    manifest = client.get(f"{API}/manifest").json()
    refused = client.post(f"{API}/enrol", ENROLMENT, content_type="application/json")

    assert manifest["accepting"] is False
    assert "demo" in manifest["message"]
    assert (refused.status_code, refused.json()["code"]) == (403, "demo_server")


def test_a_server_with_data_never_becomes_a_demo(front: FrontVersion) -> None:
    with pytest.raises(first_run.RealServerError, match="a real server"):
        first_run.mark_demo()
