"""What to use: on the page of a device, and on the page that anybody asks; whether that was right. With the
front that ships.
"""

import math
import re
from collections.abc import Callable
from typing import Any

import pytest
from django.test import Client

from crowd.dashboard.content.judgements import Maps, judgements, maps_of
from crowd.devices.models import DeviceModel
from crowd.fronts.models import Configuration
from crowd.fronts.publishing.services import publish_content
from crowd.predictions import maps
from crowd.predictions.models import DeviceMap, Recommendation
from crowd.results import moderation
from crowd.results.models import DeviceSpeedup, MeasurementSession
from tests.builders.known_front import NAME, known_front
from tests.builders.measured import ADRENO, MALI, Measured
from tests.builders.stored import join
from tests.dashboard.conftest import Filling
from tests.dashboard.reading import one_space, plain, read, text, words_of
from tests.shipped import FIXTURES

pytestmark = [pytest.mark.django_db, pytest.mark.usefixtures("phone")]

ASKED = "/recommend/?max_ate=0.02"
PHONE = "/devices/google-pixel-8/"


@pytest.fixture(scope="module")
def document() -> dict[str, Any]:
    return known_front()


@pytest.fixture(scope="module")
def phone(filling: Filling, document: dict[str, Any]) -> Measured:
    """A Pixel 8 that measured default and best."""
    with filling(FRONTRUNNER_SEQUENCES=[FIXTURES / "sequences"]):
        publish_content(document)
        first = Measured(join(), document, "Pixel 8", MALI)
        first.send()
    return first


@pytest.fixture
def measured(document: dict[str, Any]) -> Callable[[str, str], None]:
    """One more device that measured default and best."""
    return lambda device, chip: Measured(join(), document, device, chip).send()


def test_without_a_confirmed_figure_the_reference_device_alone_has_one(
    client: Client, document: dict[str, Any], settings: Any
) -> None:
    settings.FRONTRUNNER_QUORUM = 3
    (fastest,) = [point for point in document["configurations"] if point["name"] == "front-04"]
    ratio = 1 / fastest["predicted"]["on_sequence"]["runtime_ratio"]
    page = plain(client, "/recommend/?max_ate=0.018")

    assert "Nothing found: no figure of kfusion-4 is confirmed yet, 1 unconfirmed device waits" in page
    alone = "The reference device of front kfusion-4 alone has a figure. Other devices differ."
    assert f"{alone} front-04 : {ratio:.2f}x" in page
    for address in ("/tables/recommend.json", "/tables/devices/google-pixel-8/front.json"):
        assert client.get(address).status_code == 404
    assert "Its own front Not predicted: no figure of kfusion-4 is confirmed yet" in plain(client, PHONE)


def test_before_the_first_map_the_reference_device_answers(client: Client) -> None:
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
    client: Client, settings: Any, quorum: int
) -> None:
    """On the page of the front, on that of recommendations, and in the API: with the sequences behind it."""
    settings.FRONTRUNNER_QUORUM = quorum

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


def test_an_unconfirmed_device_has_the_front_of_its_chip(
    client: Client, measured: Any, settings: Any
) -> None:
    settings.FRONTRUNNER_QUORUM = 3
    for model, chip in (("Pixel 8", MALI), ("Pixel 8", MALI), ("Pixel 4", ADRENO)):
        measured(model, chip)

    page = plain(client, "/devices/google-pixel-4/")

    assert "a device with Adreno 740 (no confirmed figure). This device has no confirmed figure yet" in page
    rows = client.get("/tables/devices/google-pixel-4/front.json").json()["rows"]
    assert {row["state"] for row in rows} == {"predicted"}


def test_the_limit_of_the_error_decides_what_is_best(client: Client) -> None:
    page = plain(client, f"{PHONE}?max_ate=0.018")
    markup = client.get(f"{PHONE}?max_ate=0.018").content.decode()

    assert "Best for you within 1.80 cm front-04 :" in page
    assert "(predicted, 95 % interval" in page
    assert 'min="0.009" max="0.05" step="0.0005" value="0.018"' in markup
    assert 'data-figure="/figures/devices/google-pixel-8/front.json?max_ate=0.018"' in markup


def test_a_limit_that_cannot_be_understood_is_named_on_both_pages(client: Client) -> None:
    for address in (f"{PHONE}?max_ate=much", "/recommend/?max_ate=much"):
        response = client.get(address)
        assert response.status_code == 400
        assert "Not understood: max_ate=much: give a number above 0" in text(response)
    assert client.get("/figures/recommend.json?max_ate=much").status_code == 400


def test_a_device_without_a_valid_figure_has_no_front_of_its_own(client: Client) -> None:
    moderation.decide("quarantine", "ada", "an emulator", MeasurementSession.objects.get())

    assert "Its own front" not in read(client, PHONE)
    assert client.get("/figures/devices/google-pixel-8/front.json").status_code == 404


def test_what_nobody_measured_is_said_with_what_to_do(client: Client) -> None:
    page = plain(client, "/recommend/?model=Foo+9&max_ate=0.02")

    assert "Nothing found: no measured device is called 'Foo 9'" in page
    assert 'href="?max_ate=0.02"' in client.get("/recommend/?model=Foo+9&max_ate=0.02").content.decode()
    assert client.get("/figures/recommend.json?model=Foo+9").status_code == 404
    assert "no front of 'other' is published" in plain(client, "/recommend/?application=other")


def test_limits_that_nothing_keeps_are_named_with_the_nearest_value(client: Client) -> None:
    page = plain(client, "/recommend/?max_ate=0.001")

    assert "Not possible: no configuration has an error of at most 0.001 m" in page
    assert "Leave the time empty, or name a model" in plain(client, "/recommend/?max_ms=20")


def test_a_chip_and_a_model_are_found(client: Client, measured: Any) -> None:
    measured("Xperia 1", ADRENO)
    maps.rebuild()

    assert "a device with Adreno 650 (no confirmed figure)" in plain(client, "/recommend/?gpu=Adreno+650")
    model = plain(client, "/recommend/?model=Pixel+8")
    assert "For Google Pixel 8" in model
    assert "are the figures of the page of the device" in model


def test_a_form_without_a_script_leads_to_the_shortest_address(client: Client) -> None:
    answer = client.get("/recommend/?model=&gpu=&soc=&max_ate=0.02&max_ms=")
    by_script = client.get(
        "/recommend/?model=&gpu=&soc=&max_ate=0.02&max_ms=", headers={"HX-Request": "true"}
    )

    assert (answer.status_code, answer["Location"]) == (302, "/recommend/?max_ate=0.02")
    assert by_script["HX-Push-Url"] == "/recommend/?max_ate=0.02"


def test_home_and_every_page_lead_to_it(client: Client) -> None:
    home = client.get("/").content.decode()

    assert home.count('href="/recommend/"') == 2
    assert "What to use on your device" in read(client, "/")


def recommend(name: str, log_ratio: float, half: float) -> None:
    """As if `name` had been recommended to the only device."""
    configuration = Configuration.objects.select_related("front").get(name=name, front__slug=NAME)
    Recommendation.objects.create(
        device=DeviceModel.objects.get(),
        front=configuration.front,
        backend="opencl",
        processor="Mali-G715",
        processor_class="gpu",
        configuration=configuration,
        rung="power",
        log_ratio=log_ratio,
        low=log_ratio - half,
        high=log_ratio + half,
    )


def test_before_any_was_measured_the_page_says_so(client: Client) -> None:
    page = plain(client, "/transfer/")

    assert f"No recommendation of front {NAME} has been measured since it was made." in page
    assert f"No map of devices has been made of front {NAME} yet." in page


def test_recommendations_stand_beside_what_was_measured_and_the_published_best(
    client: Client, phone: Measured
) -> None:
    phone.submit(["default", "knee", "front-01", "front-01", "knee", "default"])
    recommend("knee", phone.log_ratio("knee"), 0.1)
    recommend("front-01", phone.log_ratio("front-01") + 0.3, 0.1)

    found = judgements(NAME)
    page = plain(client, "/transfer/")

    ratios = {name: phone.log_ratio(name) for name in ("best", "knee", "front-01")}
    slower = {name: math.exp(max(ratios.values()) - ratio) for name, ratio in ratios.items()}
    assert [row.configuration for row in found.rows] == ["knee", "front-01"]
    assert [row.within_interval for row in found.rows] == [True, False]
    assert [row.regret for row in found.rows] == pytest.approx([slower["knee"], slower["front-01"]], rel=0.01)
    assert found.worst_regret == found.rows[0].regret
    assert found.median_best_regret == found.worst_best_regret == pytest.approx(slower["best"], rel=0.01)
    assert f"2 recommendations of front {NAME} were measured after they were made. 1 of them lay" in page
    assert "Google Pixel 8 knee" in page


def test_how_many_devices_are_recommended_another_is_counted_with_the_map(phone: Measured) -> None:
    phone.submit(["default", "knee", "knee", "default"])
    DeviceSpeedup.objects.filter(configuration__name="best").update(speedup=2.0)

    maps.rebuild()

    assert maps_of(NAME).others == 1
    assert Maps([DeviceMap(other_recommended=None, devices=1)]).others is None
