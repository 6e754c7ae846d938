"""Figures over HTTP: JSON, conditional, compressed, in the theme asked for."""

import gzip
from typing import Any

import pytest
from django.test import Client

from crowd.dashboard.figures.palette import DARK, LIGHT
from tests.builders.measuring import measure
from tests.builders.stored import join

pytestmark = [pytest.mark.django_db, pytest.mark.usefixtures("session")]

SPEEDUPS = "/figures/speedups.json"


def test_every_figure_has_traces_and_a_layout_and_is_sent_once(
    client: Client, session: dict[str, Any]
) -> None:
    for address in (
        SPEEDUPS,
        f"/figures/sessions/{session['id']}/frames.json",
        f"/figures/sessions/{session['id']}/stages.json",
        f"/figures/runs/{session['runs'][0]['id']}/stages.json",
        "/figures/fronts/kfusion-test.json",
    ):
        response = client.get(address)
        again = client.get(address, headers={"If-None-Match": response["ETag"]})

        assert response["Content-Type"] == "application/json"
        assert response.json()["data"], address
        assert "xaxis" in response.json()["layout"], address
        assert (again.status_code, again.content) == (304, b""), address


def test_a_new_session_changes_the_figure(client: Client) -> None:
    etag = client.get(SPEEDUPS)["ETag"]

    measure(join(), best_us=5_000)

    assert client.get(SPEEDUPS, headers={"If-None-Match": etag}).status_code == 200


def test_each_theme_has_its_own_figure(client: Client) -> None:
    light, dark = (client.get(f"{SPEEDUPS}?theme={theme}") for theme in ("light", "dark"))

    assert LIGHT.ink in light.content.decode()
    assert DARK.ink in dark.content.decode()
    assert light["ETag"] != dark["ETag"]


def test_figures_travel_compressed(client: Client, session: dict[str, Any]) -> None:
    address = f"/figures/sessions/{session['id']}/frames.json"

    plain = client.get(address)
    packed = client.get(address, headers={"Accept-Encoding": "gzip"})

    assert packed["Content-Encoding"] == "gzip"
    assert gzip.decompress(packed.content) == plain.content
    assert len(packed.content) < len(plain.content) / 3


UNKNOWN = "front=none: give one of kfusion-test"


@pytest.mark.parametrize(
    ("address", "status", "words"),
    [
        (f"{SPEEDUPS}?since=never", 400, "since=never"),
        (f"{SPEEDUPS}?front=none", 404, UNKNOWN),
        ("/tables/transfer/best.csv?front=none", 404, UNKNOWN),
        ("/embed/transfer/correlation/?front=none", 404, UNKNOWN),
    ],
)
def test_what_cannot_be_drawn_is_named(client: Client, address: str, status: int, words: str) -> None:
    response = client.get(address)

    assert response.status_code == status
    text = response.content.decode()
    assert text == words if status == 404 else words in text


def test_figures_can_only_be_read(client: Client) -> None:
    assert client.post(SPEEDUPS).status_code == 405
