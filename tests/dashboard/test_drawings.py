"""What every figure gives besides itself: its numbers, and a page for other sites."""

import csv
import io
import json
from dataclasses import replace
from typing import Any

import pytest
from django.test import Client, RequestFactory

from crowd.dashboard.drawings import DRAWINGS
from crowd.dashboard.drawings.drawing import Table
from crowd.dashboard.drawings.serving import csv_of, json_of
from crowd.devices.models import DeviceModel
from crowd.fronts.models import FrontVersion
from crowd.results import selectors
from crowd.results.filters import SpeedupFilters
from tests.crowd.documents import session_document, submission_document
from tests.crowd.participant import Participant


def test_every_drawing_has_addresses_of_its_own() -> None:
    assert len({drawing.name for drawing in DRAWINGS}) == len({drawing.path for drawing in DRAWINGS})
    assert len({drawing.name for drawing in DRAWINGS}) == len(DRAWINGS)


def told(rows: list[tuple[Any, ...]]) -> Any:
    """A drawing without a figure, whose table holds ROWS."""
    return replace(
        DRAWINGS[0],
        table=lambda _: Table(("name", "time_s"), rows),
        title=lambda _: "",
        n=lambda _: "1\N{NO-BREAK SPACE}row",
        simulated=lambda _: False,
    )


def test_a_spreadsheet_computes_nothing_of_what_a_client_sent() -> None:
    text = csv_of(RequestFactory().get("/"), told([("=1+1", 0.5), ("plain", -1.0)]), None, {})

    assert text.splitlines() == ["name,time_s", "'=1+1,0.5", "plain,-1.0"]


def test_what_is_no_number_is_absent() -> None:
    rows = [("a", float("nan")), ("b", float("inf")), ("c", None)]
    request = RequestFactory().get("/?gpu=mali&theme=dark")

    document = json.loads(json_of(request, told(rows), None, {}))

    assert [row["time_s"] for row in document["rows"]] == [None, None, None]
    assert (document["n"], document["filters"]) == ("1 row", {"gpu": "mali"})
    assert document["page"] == "http://testserver/devices/?gpu=mali"


@pytest.mark.django_db
def test_numbers_and_embedding_of_every_figure_of_a_session(client: Client, participant: Participant) -> None:
    session = session_document()
    participant.submit(submission_document(session))
    paths = {
        "speedups": "",
        f"sessions/{session['id']}/frames": "",
        f"sessions/{session['id']}/stages": "",
        f"runs/{session['runs'][0]['id']}/stages": "",
        "fronts/kfusion-test": "",
    }

    for path in paths:
        lines = list(csv.DictReader(io.StringIO(client.get(f"/tables/{path}.csv").content.decode())))
        document = client.get(f"/tables/{path}.json").json()
        embed = client.get(f"/embed/{path}/")
        assert list(lines[0]) == document["columns"], path
        assert len(lines) == len(document["rows"]) > 0, path
        assert document["licence"]["name"] == "CC-BY-4.0"
        assert f'data-figure="/figures/{path}.json"' in embed.content.decode()
        assert document["n"] in embed.content.decode().replace("\N{NO-BREAK SPACE}", " ")
        assert "frame-ancestors *;" in embed["Content-Security-Policy"] + ";"
        assert "X-Frame-Options" not in embed
        assert not embed.cookies
    assert "frame-ancestors 'none'" in client.get("/")["Content-Security-Policy"]


@pytest.mark.django_db
def test_numbers_are_those_that_the_page_shows_under_its_filters(
    client: Client, participant: Participant
) -> None:
    participant.submit(submission_document(session_document()))
    (shown,) = selectors.speedups(SpeedupFilters()).rows

    (row,) = client.get("/tables/speedups.json?vendor=Mali").json()["rows"]

    assert (row["speedup"], row["sessions"], row["state"]) == (shown.speedup, shown.sessions, "valid")
    assert client.get("/tables/speedups.json?vendor=Adreno").json()["rows"] == []
    assert client.get("/tables/speedups.csv?since=never").status_code == 400


@pytest.mark.django_db
@pytest.mark.parametrize("path", ["transfer/best", "transfer/winners", "transfer/correlation", "speedups"])
def test_what_leaves_a_page_tells_its_filters_and_that_it_is_simulated(
    client: Client, front: FrontVersion, path: str
) -> None:
    under = "?simulated=1&vendor=Adreno"
    document = client.get(f"/tables/{path}.json{under}").json()
    embed = client.get(f"/embed/{path}/{under}").content.decode()

    assert document["simulated"] is True
    assert document["title"].endswith("front kfusion-test, simulated devices, Qualcomm Adreno")
    assert "Simulated.</strong>" in embed
    assert document["title"].partition(", ")[2] in embed
    assert client.get(f"/tables/{path}.json").json()["simulated"] is False
    assert "Simulated.</strong>" not in client.get(f"/embed/{path}/").content.decode()


@pytest.mark.django_db
def test_figures_of_a_simulated_device_say_so(client: Client, participant: Participant) -> None:
    session = session_document()
    participant.submit(submission_document(session))
    DeviceModel.objects.update(kind=DeviceModel.Kind.SIMULATED)
    run = session["runs"][0]["id"]
    paths = [
        *(f"devices/google-pixel-8/{name}" for name in ("configurations", "crowd", "history")),
        *(f"sessions/{session['id']}/{name}" for name in ("drift", "sensors", "frames", "stages")),
        f"runs/{run}/stages",
    ]

    for path in paths:
        assert client.get(f"/tables/{path}.json").json()["simulated"] is True, path
