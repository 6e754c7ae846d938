"""Figures over HTTP: JSON, conditional, compressed, in the theme asked for."""

import gzip
from typing import Any

import pytest
from django.test import Client

from crowd.dashboard.figures.palette import DARK, LIGHT
from tests.builders.documents import session_document, submission_document
from tests.builders.participant import Participant

pytestmark = pytest.mark.django_db


@pytest.fixture
def session(participant: Participant) -> dict[str, Any]:
    """One session of one phone, through the API."""
    document = session_document()
    participant.submit(submission_document(document))
    return document


def addresses(session: dict[str, Any]) -> list[str]:
    return [
        "/figures/speedups.json",
        f"/figures/sessions/{session['id']}/frames.json",
        f"/figures/sessions/{session['id']}/stages.json",
        f"/figures/runs/{session['runs'][0]['id']}/stages.json",
        "/figures/fronts/kfusion-test.json",
    ]


def test_every_figure_has_traces_and_a_layout(client: Client, session: dict[str, Any]) -> None:
    for address in addresses(session):
        response = client.get(address)
        assert response["Content-Type"] == "application/json"
        figure = response.json()
        assert figure["data"], address
        assert "xaxis" in figure["layout"], address


def test_the_same_figure_is_sent_once(client: Client, session: dict[str, Any]) -> None:
    for address in addresses(session):
        first = client.get(address)
        again = client.get(address, headers={"If-None-Match": first["ETag"]})
        assert (again.status_code, again.content) == (304, b""), address


def test_a_new_session_changes_the_figure(
    client: Client, session: dict[str, Any], participant: Participant
) -> None:
    etag = client.get("/figures/speedups.json")["ETag"]

    participant.submit(submission_document(session_document(best_us=5_000)))

    assert client.get("/figures/speedups.json", headers={"If-None-Match": etag}).status_code == 200


def test_each_theme_has_its_own_figure(client: Client, session: dict[str, Any]) -> None:
    light = client.get("/figures/speedups.json?theme=light")
    dark = client.get("/figures/speedups.json?theme=dark")

    assert LIGHT.ink in light.content.decode()
    assert DARK.ink in dark.content.decode()
    assert light["ETag"] != dark["ETag"]


def test_figures_travel_compressed(client: Client, session: dict[str, Any]) -> None:
    address = addresses(session)[1]

    plain = client.get(address)
    packed = client.get(address, headers={"Accept-Encoding": "gzip"})

    assert packed["Content-Encoding"] == "gzip"
    assert gzip.decompress(packed.content) == plain.content
    assert len(packed.content) < len(plain.content) / 3


def test_a_wrong_filter_is_named(client: Client, session: dict[str, Any]) -> None:
    response = client.get("/figures/speedups.json?since=never")

    assert (response.status_code, b"since=never" in response.content) == (400, True)


@pytest.mark.parametrize(
    "address", ["/figures/speedups.json", "/tables/transfer/best.csv", "/embed/transfer/correlation/"]
)
def test_an_unknown_front_has_no_figure(client: Client, session: dict[str, Any], address: str) -> None:
    response = client.get(f"{address}?front=none")

    assert response.status_code == 404
    assert response.content == b"front=none: give one of kfusion-test"


def test_figures_can_only_be_read(client: Client, session: dict[str, Any]) -> None:
    assert client.post("/figures/speedups.json").status_code == 405
