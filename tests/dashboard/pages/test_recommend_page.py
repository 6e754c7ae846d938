"""What to use: on the page of a device, and on the page that anybody asks; with the front that ships."""

import re
from typing import Any

import pytest
from django.test import Client

from crowd.fronts.models import FrontVersion
from crowd.predictions import maps
from crowd.results import moderation
from crowd.results.models import MeasurementSession
from tests.builders.measured import ADRENO, BEST_IS_BEST
from tests.dashboard.reading import read, text, words_of
from tests.predictions.conftest import document, front, measured

__all__ = ["document", "front", "measured"]

pytestmark = pytest.mark.django_db

ASKED = "/recommend/?max_ate=0.02"
PHONE = "/devices/google-pixel-8/"


def plain(client: Client, address: str) -> str:
    return one_space(read(client, address))


def one_space(words: str) -> str:
    return words.replace("\N{NO-BREAK SPACE}", " ").replace("\N{NARROW NO-BREAK SPACE}", " ")


@pytest.mark.slow
def test_without_a_confirmed_figure_the_reference_device_alone_has_one(
    client: Client, measured: Any, document: dict[str, Any], settings: Any
) -> None:
    settings.FRONTRUNNER_QUORUM = 3
    measured("Pixel 8")
    [fastest] = [point for point in document["configurations"] if point["name"] == "front-04"]
    ratio = 1 / fastest["predicted"]["on_sequence"]["runtime_ratio"]
    page = plain(client, "/recommend/?max_ate=0.018")

    assert "Nothing found: no figure of kfusion-4 is confirmed yet, 1 unconfirmed device waits" in page
    alone = "The reference device of front kfusion-4 alone has a figure. Other devices differ."
    assert f"{alone} front-04 : {ratio:.2f}x" in page
    for address in ("/tables/recommend.json", "/tables/devices/google-pixel-8/front.json"):
        assert client.get(address).status_code == 404
    assert "Its own front Not predicted: no figure of kfusion-4 is confirmed yet" in plain(client, PHONE)


@pytest.mark.slow
def test_before_the_first_map_the_reference_device_answers(client: Client, measured: Any) -> None:
    measured("Pixel 8")
    page = plain(client, "/recommend/?max_ate=0.018")

    assert "For any device" in page
    assert "front-04 :" in page
    assert "Only the reference device: there is no map of devices yet." in page
    assert "volume resolution 128" in page
    assert "frontrunner measure choose \\ --server http://testserver \\ --max-ate 0.018" in page
    table = client.get("/tables/recommend.json?max_ate=0.018").json()
    assert [row["configuration"] for row in table["rows"] if row["recommended"]] == ["front-04"]
    assert {row["state"] for row in table["rows"]} == {"predicted"}


RECOMMENDED = re.compile(r'<p class="lede" data-recommended="(.*?)".*?</p>\s*<p class="muted">.*?</p>', re.S)


@pytest.mark.parametrize("quorum", [1, 3])
def test_the_fastest_below_two_centimetres_is_the_same_everywhere(
    client: Client, measured: Any, settings: Any, quorum: int
) -> None:
    """On the page of the front, on that of recommendations, and in the API: with the sequences behind it."""
    settings.FRONTRUNNER_QUORUM = quorum
    measured("Pixel 8")

    pages = [client.get(address).content.decode() for address in ("/fronts/kfusion-4/", ASKED)]
    answers = [match for page in pages for match in RECOMMENDED.finditer(page)]

    assert len(answers) == 2
    assert answers[0].group(1) == answers[1].group(1) == "front-04"
    assert answers[0].group() == answers[1].group()
    words = one_space(words_of(answers[0].group()))
    assert "Largest trajectory error on 6 sequences learned on: 1.57 cm." in words
    assert "On 2 held-out sequences: 1.88 cm (the default: 1.60 cm)." in words
    api = client.get(f"/api/v1{ASKED.replace('recommend/', 'recommendation')}")
    if quorum == 1:
        body = api.json()
        assert body["configuration"] == "front-04"
        assert f"{body['predicted']['ratio']:.2f}x" in words
        assert (f"{100 * body['ate_max']:.2f}", f"{100 * body['held_out_ate_max']:.2f}") == ("1.57", "1.88")
    else:
        assert "no figure of kfusion-4 is confirmed yet" in api.json()["detail"]


@pytest.mark.slow
def test_an_unconfirmed_device_has_the_front_of_its_chip(
    client: Client, measured: Any, settings: Any
) -> None:
    settings.FRONTRUNNER_QUORUM = 3
    for _ in range(3):
        measured("Pixel 8")
    measured("Pixel 4", ADRENO)

    page = plain(client, "/devices/google-pixel-4/")

    assert "a device with Adreno 740 (no confirmed figure). This device has no confirmed figure yet" in page
    rows = client.get("/tables/devices/google-pixel-4/front.json").json()["rows"]
    assert {row["state"] for row in rows} == {"predicted"}


@pytest.mark.slow
def test_a_device_has_its_own_front_measured_and_predicted(client: Client, measured: Any) -> None:
    measured("Pixel 8", costs=BEST_IS_BEST)
    measured("Pixel 7", costs=BEST_IS_BEST, probes=["probe-02"])
    (row,) = maps.rebuild()

    page = plain(client, PHONE)

    assert "Best for you within 5.00 cm best :" in page
    assert "(measured here)" in page
    assert "Google Pixel 7 : its chip is of the series Mali-G7" in page
    assert "which learned from 2 devices in 2 sessions with OpenCL on graphics chips" in page
    assert "Measured configurations are the figures of the table below." in page
    assert f"from the map of {row.made_at:%Y-%m-%d}" in page
    rows = client.get("/tables/devices/google-pixel-8/front.json").json()["rows"]
    states = {row["configuration"]: row["state"] for row in rows}
    assert (states["best"], states["knee"], states["probe-02"]) == ("measured", "predicted", "predicted")


@pytest.mark.slow
def test_the_limit_of_the_error_decides_what_is_best(client: Client, measured: Any) -> None:
    measured("Pixel 8")

    page = plain(client, f"{PHONE}?max_ate=0.018")
    markup = client.get(f"{PHONE}?max_ate=0.018").content.decode()

    assert "Best for you within 1.80 cm front-04 :" in page
    assert "(predicted, 95 % interval" in page
    assert 'min="0.009" max="0.05" step="0.0005" value="0.018"' in markup
    assert 'data-figure="/figures/devices/google-pixel-8/front.json?max_ate=0.018"' in markup


@pytest.mark.slow
def test_a_limit_that_cannot_be_understood_is_named_on_both_pages(client: Client, measured: Any) -> None:
    measured("Pixel 8")

    for address in (f"{PHONE}?max_ate=much", "/recommend/?max_ate=much"):
        response = client.get(address)
        assert response.status_code == 400
        assert "Not understood: max_ate=much: give a number above 0" in text(response)
    assert client.get("/figures/recommend.json?max_ate=much").status_code == 400


def test_a_device_without_a_valid_figure_has_no_front_of_its_own(client: Client, measured: Any) -> None:
    measured("Pixel 8")
    moderation.decide("quarantine", "ada", "an emulator", MeasurementSession.objects.get())

    assert "Its own front" not in read(client, PHONE)
    assert client.get("/figures/devices/google-pixel-8/front.json").status_code == 404


def test_what_nobody_measured_is_said_with_what_to_do(client: Client, front: FrontVersion) -> None:
    page = plain(client, "/recommend/?model=Foo+9&max_ate=0.02")

    assert "Nothing found: no measured device is called 'Foo 9'" in page
    assert 'href="?max_ate=0.02"' in client.get("/recommend/?model=Foo+9&max_ate=0.02").content.decode()
    assert client.get("/figures/recommend.json?model=Foo+9").status_code == 404
    assert "no front of 'other' is published" in plain(client, "/recommend/?application=other")


@pytest.mark.slow
def test_limits_that_nothing_keeps_are_named_with_the_nearest_value(client: Client, measured: Any) -> None:
    measured()
    page = plain(client, "/recommend/?max_ate=0.001")

    assert "Not possible: no configuration has an error of at most 0.001 m" in page
    assert "Leave the time empty, or name a model" in plain(client, "/recommend/?max_ms=20")


def test_an_instance_without_a_front_says_how_to_publish_one(client: Client, db: None) -> None:
    assert "No front has been published here yet." in read(client, "/recommend/")


@pytest.mark.slow
def test_a_chip_and_a_model_are_found(client: Client, measured: Any) -> None:
    measured("Pixel 8")
    measured("Xperia 1", ADRENO)
    maps.rebuild()

    assert "a device with Adreno 650 (no confirmed figure)" in plain(client, "/recommend/?gpu=Adreno+650")
    model = plain(client, "/recommend/?model=Pixel+8")
    assert "For Google Pixel 8" in model
    assert "are the figures of the page of the device" in model


@pytest.mark.slow
def test_a_form_without_a_script_leads_to_the_shortest_address(client: Client, front: FrontVersion) -> None:
    answer = client.get("/recommend/?model=&gpu=&soc=&max_ate=0.02&max_ms=")
    by_script = client.get(
        "/recommend/?model=&gpu=&soc=&max_ate=0.02&max_ms=", headers={"HX-Request": "true"}
    )

    assert (answer.status_code, answer["Location"]) == (302, "/recommend/?max_ate=0.02")
    assert by_script["HX-Push-Url"] == "/recommend/?max_ate=0.02"


@pytest.mark.slow
def test_rare_devices_keep_their_masks(client: Client, measured: Any, settings: Any) -> None:
    settings.FRONTRUNNER_RARE_BELOW = 5
    measured("Pixel 8")
    measured("Pixel 7")
    maps.rebuild()
    public = client.get("/api/v1/devices").json()["results"]

    addresses = [f"/devices/{row['slug']}/" for row in public]
    pages = [read(client, address) for address in (*addresses, "/recommend/?gpu=Mali-G715", "/transfer/")]

    assert len(addresses) == 2
    assert "Its own front" in pages[0]
    assert not any("Pixel" in page for page in pages)
    assert "no measured device" in read(client, "/recommend/?model=Pixel+8")


def test_home_and_every_page_lead_to_it(client: Client, front: FrontVersion) -> None:
    home = client.get("/").content.decode()

    assert home.count('href="/recommend/"') == 2
    assert "What to use on your device" in read(client, "/")
