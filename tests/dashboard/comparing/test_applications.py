"""Two applications on one server: a page is about one of them, says about which, and leads to the other."""

import re

import pytest
from django.test import Client

from crowd.fronts.publishing.services import publish_content
from tests.builders.documents import front_document
from tests.builders.measuring import measure
from tests.builders.participant import API
from tests.builders.stored import join
from tests.dashboard.conftest import Filling
from tests.dashboard.reading import read, text

pytestmark = [pytest.mark.django_db, pytest.mark.usefixtures("both")]

OTHER = {"application": "other", "front": "other-test"}


@pytest.fixture(scope="module")
def both(filling: Filling) -> None:
    """Pixel 8 was measured with both applications, last with the other one; Pixel 6 and 7 with one each."""
    with filling() as pack:
        publish_content(front_document(pack))
        publish_content(front_document(pack, application="other"))
        measure(join(), "Pixel 6", best_us=20_000)
        first = join()
        measure(first, "Pixel 8")
        measure(first, "Pixel 8", best_us=40_000, **OTHER)
        measure(join(), "Pixel 7", best_us=20_000, **OTHER)


def test_figures_of_two_applications_are_never_averaged(client: Client) -> None:
    one, other = client.get("/"), client.get("/?application=other")
    links = 'aria-current="true">KinectFusion</strong><a href="/?application=other">other</a>'

    assert "5.66x faster across 2 devices" in text(one)
    assert "2.83x faster across 2 devices" in text(other)
    assert "searched the configurations of KinectFusion" in text(one)
    assert links in one.content.decode()
    assert 'data-figure="/figures/speedups.json?application=other"' in other.content.decode()
    assert "Measured last Google Pixel 7 4.00x" in text(other)
    assert "Only other" not in text(other)


def test_a_front_names_its_application(client: Client) -> None:
    assert client.get("/?front=other-test")["Location"] == "/devices/?front=other-test&application=other"
    assert "2.83x faster in the mean" in read(client, "/devices/?front=other-test")
    assert client.get("/?front=other-test&application=kfusion").status_code == 400
    assert read(client, "/fronts/other-test/").count("2.83x 2") == 1
    rows = client.get("/tables/speedups.json?front=other-test").json()["rows"]
    assert [row["device"] for row in rows] == ["google-pixel-7", "google-pixel-8"]


def test_lists_are_of_one_application(client: Client) -> None:
    assert "Pixel 7" not in read(client, "/devices/")
    assert "Pixel 6" not in read(client, "/devices/?application=other")
    page = client.get("/devices/?application=other").content.decode()
    assert 'href="/devices/google-pixel-8/?application=other"' in page
    rows = client.get(f"{API}/devices?application=other").json()["results"]
    shown = {row["slug"]: row["speedup"] for row in rows}
    assert shown["google-pixel-6"] is None
    assert (shown["google-pixel-7"], shown["google-pixel-8"]) == (pytest.approx(4.0), pytest.approx(2.0))


def test_a_device_shows_one_application_and_leads_to_the_other(client: Client) -> None:
    newest, asked = (client.get(f"/devices/google-pixel-8/{query}") for query in ("", "?application=kfusion"))

    assert "Speedup of best over default 2.00x" in text(newest)
    assert "8.00x" not in text(newest)
    assert "Speedup of best over default 8.00x" in text(asked)
    assert "2.00x" not in text(asked)
    assert 'href="?application=kfusion">KinectFusion</a>' in newest.content.decode()
    figure = "/figures/devices/google-pixel-8/crowd.json?application=kfusion"
    assert f'data-figure="{figure}"' in asked.content.decode()
    assert client.get(figure).status_code == 200
    assert client.get("/devices/google-pixel-8/?application=none").status_code == 404
    assert "Application" not in text(client.get("/devices/google-pixel-7/"))


def test_what_stands_side_by_side_is_of_one_application(client: Client) -> None:
    pair = read(client, "/compare/?devices=google-pixel-8,google-pixel-6")
    apart = client.get("/compare/?devices=google-pixel-7,google-pixel-6")
    names = read(client, "/compare/?device=google-pixel-8&configurations=default,best&application=kfusion")

    assert "Speedup 8.00x 4.00x" in pair
    assert "other-test" not in pair
    assert apart.status_code == 400
    assert "cannot be compared: no application was measured on all" in text(apart)
    assert "front kfusion-test" in names
    assert "Speedup 1.00x 8.00x" in names


def test_what_to_type_names_another_application_than_the_usual_one(client: Client) -> None:
    typed = "--server http://testserver --application other"

    for address in ("/", "/devices/?device=none", "/transfer/"):
        sign = "&" if "?" in address else "?"
        assert typed in read(client, f"{address}{sign}application=other"), address
        assert "--application" not in read(client, address), address
    assert "measure --application other --configurations all" in read(client, "/fronts/other-test/")


@pytest.mark.parametrize("address", ["/devices/", "/transfer/"])
def test_showing_all_again_stays_with_the_application(client: Client, address: str) -> None:
    page = client.get(f"{address}?application=other&device=none").content.decode()

    _, _, results = page.partition('id="results"')
    assert f'<a href="{address}?application=other">Show' in results


def test_every_way_to_a_device_stays_with_the_application(client: Client) -> None:
    row = client.get(f"{API}/devices/google-pixel-8").json()["sessions"][-1]  # the first: of kfusion
    session = f"/sessions/{row['id']}/"
    run = re.findall(r'"(/runs/[^"]+)"', client.get(session).content.decode())[0]
    pages = (session, run, "/compare/?devices=google-pixel-8,google-pixel-6")

    for address in pages:
        page = client.get(address).content.decode()
        assert 'href="/devices/?application=kfusion">Devices' in page, address
        assert 'href="/devices/google-pixel-8/?application=kfusion"' in page, address
    page = client.get("/devices/google-pixel-8/").content.decode()
    assert 'href="/devices/?application=other">Devices' in page


def test_a_devices_card_is_of_the_pages_application(client: Client) -> None:
    page = client.get("/devices/google-pixel-8/?application=kfusion").content.decode()
    (address,) = re.findall(r'property="og:image" content="http://testserver([^"]+)"', page)

    assert address == "/devices/google-pixel-8/card.png?application=kfusion"
    assert client.get(address)["ETag"] != client.get("/devices/google-pixel-8/card.png")["ETag"]
    assert client.get("/devices/google-pixel-8/card.png?application=none").status_code == 404


def test_a_list_of_some_sessions_says_what_its_counts_are_of(client: Client) -> None:
    sentence = "The newest 1 with other; with all applications together there are 2."
    assert sentence in read(client, "/devices/google-pixel-8/")
