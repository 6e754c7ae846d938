"""Tables of devices: sorted by their column heads, whole or in pages; an empty one says why."""

import re
from typing import Any

import pytest
from django.test import Client

from crowd.dashboard.sorting import Order
from crowd.dashboard.views import devices
from crowd.results.reading.queries.filters import InvalidFilterError
from tests.builders.measuring import measure
from tests.builders.rows import device, speedup
from tests.builders.stored import join
from tests.dashboard.conftest import Filling
from tests.dashboard.reading import read, text

pytestmark = [pytest.mark.django_db, pytest.mark.usefixtures("slower")]


@pytest.fixture(scope="module")
def slower(session: dict[str, Any], filling: Filling) -> None:
    """A Pixel 7, whose best is twice as fast."""
    with filling():
        measure(join(), "Pixel 7", best_us=40_000)


def slugs(order: str, *rows: Any) -> list[str]:
    return [row.device.slug for row in Order.parse(order).sort(rows)]


def test_rows_are_sorted_by_the_named_column() -> None:
    rows = (
        speedup(6.0, "b", sessions=1, device=device("b", os="Linux")),
        speedup(4.0, "a", sessions=9, device=device("a", os="")),
        speedup(5.0, "c", sessions=4, device=device("c", os="Android")),
    )

    assert slugs("", *rows) == ["b", "c", "a"]
    assert slugs("speedup", *rows) == ["a", "c", "b"]
    assert slugs("device", *rows) == ["a", "b", "c"]
    assert slugs("-sessions", *rows) == ["a", "c", "b"]
    # What is not known comes last, whatever the direction.
    assert slugs("system", *rows) == ["c", "b", "a"]
    assert slugs("-system", *rows) == ["b", "c", "a"]


def test_no_unconfirmed_figure_stands_above_a_confirmed_one_by_size() -> None:
    rows = (speedup(90.0, "invented", low=80.0, high=99.0, confirmed=False), speedup(2.0, "real", low=1.9))

    assert slugs("-speedup", *rows) == ["real", "invented"]
    assert slugs("-interval", *rows) == ["real", "invented"]


def test_a_click_sorts_a_column_its_usual_way_and_then_the_other() -> None:
    shown = Order.parse("")

    assert shown.after_click("sessions").text == "-sessions"
    assert shown.after_click("device").text == "device"
    assert shown.after_click("device").after_click("device").text == "-device"
    assert shown.after_click("speedup").after_click("speedup").text == "", "the default needs no name"
    with pytest.raises(InvalidFilterError, match="give one of device, speedup"):
        Order.parse("colour")


def test_column_heads_link_to_the_sorted_table_under_the_same_filters(client: Client) -> None:
    page = client.get("/devices/?gpu=mali&sort=device").content.decode()

    table = page.partition("<tbody>")[2]
    assert table.index("google-pixel-7") < table.index("google-pixel-8")
    heads = re.findall(r'<th scope="col"[^>]*?(?: aria-sort="(\w+)")?><a href="([^"]+)">(\w+)', page)
    assert ("ascending", "/devices/?gpu=mali&amp;sort=-device#rows", "Device") in heads
    assert ("", "/devices/?gpu=mali#rows", "Speedup") in heads
    # Charts do not depend on the order; the form keeps it.
    assert 'data-figure="/figures/speedups.json?gpu=mali"' in page
    assert '<input type="hidden" name="sort" value="device">' in page


def test_an_unknown_order_is_named_and_refused(client: Client) -> None:
    response = client.get("/devices/?sort=colour")

    assert response.status_code == 400
    assert "sort=colour: give one of" in text(response)


def test_a_table_comes_in_pages_or_whole(client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(devices, "PAGE", 2)
    measure(join(), "Pixel 6")

    part = client.get("/devices/?sort=device").content.decode()

    assert 'href="?sort=device&amp;page=2"' in part
    assert 'href="/devices/?sort=device&amp;rows=all"' in part
    whole = client.get("/devices/?sort=device&rows=all").content.decode()
    assert whole.count('name="devices"') == 3
    assert "Pages of the table" not in whole


def test_an_empty_answer_says_which_filter_emptied_it(client: Client) -> None:
    response = client.get("/devices/?vendor=Mali&os=Windows")

    page = text(response)
    assert "No device matches these filters: Arm Mali, system “Windows”" in page
    assert "Remove the filter system “Windows” : 2 figures without it" in page
    assert "Remove the filter Arm Mali" not in page
    assert 'href="/devices/?vendor=Mali"' in response.content.decode()


def test_filters_that_are_empty_only_together_are_each_named(client: Client) -> None:
    either = read(client, "/devices/?os=Windows&vendor=Adreno")
    one = read(client, "/devices/?until=2020-01-01")

    assert "No single filter is the reason" in either
    assert "Remove the filter until 2020-01-01 : 2 figures without it" in one
