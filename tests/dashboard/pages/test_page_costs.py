"""What a page costs its reader and the server: bytes, hosts, queries."""

import gzip
import re
from pathlib import Path
from typing import Any

import pytest
from django.contrib.staticfiles import finders
from django.test import Client
from django.urls import reverse

from crowd.dashboard.views import devices
from crowd.fronts.publishing.services import publish_content
from tests.builders.documents import front_document
from tests.builders.measuring import measure
from tests.builders.stored import join
from tests.dashboard.conftest import Filling
from tests.dashboard.reading import text

pytestmark = [pytest.mark.django_db, pytest.mark.usefixtures("phones")]
NAMES = ("home", "devices", "fronts", "data", "about")
COUNT = 12


@pytest.fixture(scope="module")
def phones(filling: Filling) -> None:
    """As many models, one of them with six sessions."""
    with filling() as pack:
        publish_content(front_document(pack))
        for number in range(COUNT):
            measure(join(), f"Pixel {number}", best_us=8_000 + 500 * number)
        one = join()
        for best_us in range(8_000, 13_000, 1_000):
            measure(one, "Pixel 8", best_us=best_us)


@pytest.mark.parametrize("name", NAMES)
def test_pages_load_nothing_from_another_host(client: Client, name: str) -> None:
    page = client.get(reverse(f"dashboard:{name}")).content.decode()

    loaded = re.findall(r"<(?:script|link|img|iframe|source)[^>]+(?:src|href)=\"([^\"]+)\"", page)
    assert loaded
    assert all(address.startswith("/static/") for address in loaded), loaded
    assert not re.search(r"<script(?![^>]*src=)", page)
    assert "<style" not in page


def test_the_chart_of_the_home_page_is_seen_after_few_bytes(client: Client) -> None:
    page = client.get("/").content

    assert b'<rect class="family-mali"' in page
    assert len(page) < 60_000
    linked = re.findall(rb'<(?:script src|link rel="stylesheet"[^>]* href)="/static/([^"]+)"', page)
    files = [Path(str(finders.find(address.decode()))) for address in linked]
    assert "style.css" in {file.name for file in files}
    assert sum(len(gzip.compress(body)) for body in (page, *map(Path.read_bytes, files))) < 150_000


@pytest.mark.parametrize(
    ("address", "first", "again"),
    [
        ("/", 21, 11),
        ("/devices/", 17, 6),
        ("/fronts/", 3, 3),
        ("/fronts/kfusion-test/", None, 8),
        ("/devices/google-pixel-1/", 39, 17),
        ("/devices/google-pixel-8/", 39, 17),  # with many sessions
    ],
)
def test_a_page_asks_the_database_as_often_for_one_device_as_for_many_and_less_while_no_figure_changes(
    client: Client, django_assert_max_num_queries: Any, address: str, first: int | None, again: int
) -> None:
    for budget in (first or 1000, again):
        with django_assert_max_num_queries(budget):
            client.get(address)


def test_long_tables_come_in_pages_under_the_same_filters(
    client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(devices, "PAGE", 8)

    first = client.get("/devices/?gpu=mali")
    last = client.get("/devices/?gpu=mali&page=2")

    assert "Rows 1 to 8 of 12" in text(first)
    assert 'href="?gpu=mali&amp;page=2"' in first.content.decode()
    assert "Rows 9 to 12 of 12" in text(last)
    assert 'data-figure="/figures/speedups.json?gpu=mali"' in last.content.decode()


@pytest.mark.parametrize("address", ["/", "/devices/", "/devices/google-pixel-1/", "/about/"])
def test_pages_travel_compressed_and_can_only_be_read(client: Client, address: str) -> None:
    response = client.get(address, headers={"Accept-Encoding": "gzip"})

    assert response["Content-Encoding"] == "gzip"
    page = gzip.decompress(response.content)  # what was sent has up to 100 bytes at random
    assert len(gzip.compress(page)) < 8_500
    assert len(response.content) < len(page) / 2
    assert client.post(address).status_code == 405
