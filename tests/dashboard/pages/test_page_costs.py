"""What a page costs its reader and the server: bytes, hosts, queries."""

import gzip
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from django.contrib.staticfiles import finders
from django.test import Client
from django.urls import reverse

from crowd.dashboard.views import devices
from crowd.fronts.models import FrontVersion
from tests.builders.measuring import measure
from tests.builders.participant import Participant
from tests.dashboard.reading import text

pytestmark = pytest.mark.django_db


@pytest.mark.slow
@pytest.mark.parametrize("name", ["home", "devices", "fronts", "data", "about"])
def test_pages_load_nothing_from_another_host(client: Client, participant: Participant, name: str) -> None:
    measure(participant)

    page = client.get(reverse(f"dashboard:{name}")).content.decode()

    loaded = re.findall(r"<(?:script|link|img|iframe|source)[^>]+(?:src|href)=\"([^\"]+)\"", page)
    assert loaded
    assert all(address.startswith("/static/") for address in loaded), loaded
    assert not re.search(r"<script(?![^>]*src=)", page)
    assert "<style" not in page


def test_pages_without_charts_do_not_load_the_plot_library(client: Client, front: FrontVersion) -> None:
    for name in ("home", "devices", "fronts", "data", "about"):
        assert b"plotly" not in client.get(reverse(f"dashboard:{name}")).content, name


def test_the_chart_of_the_home_page_is_seen_after_few_bytes(client: Client, participant: Participant) -> None:
    measure(participant)

    page = client.get("/").content

    assert b'<rect class="family-mali"' in page
    linked = re.findall(rb'<(?:script src|link rel="stylesheet"[^>]* href)="/static/([^"]+)"', page)
    files = [Path(str(finders.find(address.decode()))) for address in linked]
    assert "style.css" in {file.name for file in files}
    assert sum(len(gzip.compress(body)) for body in (page, *map(Path.read_bytes, files))) < 150_000


@pytest.mark.slow
@pytest.mark.parametrize(("address", "budget"), [("/", 21), ("/devices/", 17), ("/fronts/", 3)])
def test_lists_ask_the_database_as_often_for_one_device_as_for_many(
    client: Client,
    join: Callable[[], Participant],
    front: FrontVersion,
    django_assert_max_num_queries: Any,
    address: str,
    budget: int,
) -> None:
    for number in range(6):
        measure(join(), f"Pixel {number}", best_us=8_000 + 500 * number)

    with django_assert_max_num_queries(budget):
        client.get(address)


@pytest.mark.slow
def test_the_device_page_keeps_to_its_queries_with_many_sessions(
    client: Client, participant: Participant, django_assert_max_num_queries: Any
) -> None:
    for best_us in range(8_000, 14_000, 1_000):
        measure(participant, best_us=best_us)

    with django_assert_max_num_queries(39):
        client.get("/devices/google-pixel-8/")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("address", "budget"), [("/", 11), ("/devices/", 6), ("/devices/google-pixel-1/", 17)]
)
def test_a_page_asks_less_while_no_figure_changes(
    client: Client,
    join: Callable[[], Participant],
    front: FrontVersion,
    django_assert_max_num_queries: Any,
    address: str,
    budget: int,
) -> None:
    for number in range(3):
        measure(join(), f"Pixel {number}", best_us=8_000 + 500 * number)
    client.get(address)

    with django_assert_max_num_queries(budget):
        client.get(address)


@pytest.mark.slow
def test_the_home_page_stays_small_without_the_plot_library(
    client: Client, join: Callable[[], Participant], front: FrontVersion
) -> None:
    for number in range(12):
        measure(join(), f"Pixel {number}")

    assert len(client.get("/").content) < 60_000


def test_long_tables_come_in_pages_under_the_same_filters(
    client: Client,
    join: Callable[[], Participant],
    front: FrontVersion,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(devices, "PAGE", 2)
    for number in range(3):
        measure(join(), f"Pixel {number}", best_us=8_000 + 500 * number)

    first = client.get("/devices/?gpu=mali")
    last = client.get("/devices/?gpu=mali&page=2")

    assert "Rows 1 to 2 of 3" in text(first)
    assert 'href="?gpu=mali&amp;page=2"' in first.content.decode()
    assert "Rows 3 to 3 of 3" in text(last)
    assert 'data-figure="/figures/speedups.json?gpu=mali"' in last.content.decode()


def test_pages_travel_compressed(client: Client, participant: Participant) -> None:
    measure(participant)

    for address in ("/", "/devices/", "/devices/google-pixel-8/", "/about/"):
        response = client.get(address, headers={"Accept-Encoding": "gzip"})
        assert response["Content-Encoding"] == "gzip", address
        assert len(response.content) < 8_000, address


@pytest.mark.parametrize("address", ["/", "/devices/", "/about/"])
def test_pages_can_only_be_read(client: Client, address: str) -> None:
    assert client.post(address).status_code == 405
