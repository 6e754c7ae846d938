"""Models that an owner chooses from."""

from typing import Any

import pytest
from django.test import Client

from crowd.devices.models import CatalogueEntry
from crowd.devices.naming.identity import identify
from tests.builders.documents import browser_document, device_document
from tests.builders.participant import API

pytestmark = pytest.mark.django_db


@pytest.fixture(autouse=True)
def catalogue() -> None:
    CatalogueEntry.objects.bulk_create(
        [
            CatalogueEntry(maker="samsung", device="a16x", code="sm-a166b", market_name="Galaxy A16 5G"),
            CatalogueEntry(maker="samsung", device="e1", code="sm-s921b", market_name="Galaxy S24"),
            CatalogueEntry(maker="google", device="husky", code="pixel 8 pro", market_name="Pixel 8 Pro"),
            CatalogueEntry(maker="", device="x", code="x1", market_name="Galaxy without a maker"),
        ]
    )


def find(client: Client, **query: str) -> list[dict[str, Any]]:
    answer = client.get(f"{API}/models", query)
    assert answer.status_code == 200
    return answer.json()["results"]


def test_the_catalogue_is_searched_by_name_code_and_maker(client: Client) -> None:
    galaxy = {"manufacturer": "Samsung", "model": "SM-A166B", "name": "Galaxy A16 5G (SM-A166B)"}

    assert find(client, search="galaxy a16") == [galaxy]
    assert find(client, search="samsung a16") == [galaxy]
    assert galaxy in find(client, search="SM-A166B")
    assert galaxy in find(client, maker="samsung")
    assert find(client, search="pixel 8 pro") == [
        {"manufacturer": "Google", "model": "Pixel 8 Pro", "name": "Pixel 8 Pro"}
    ]
    assert find(client, maker="google", search="galaxy") == []


def test_iphones_are_listed_without_a_catalogue(client: Client) -> None:
    found = find(client, search="iphone 15")

    assert [row["name"] for row in found] == [
        "iPhone 15", "iPhone 15 Plus", "iPhone 15 Pro", "iPhone 15 Pro Max",
    ]  # fmt: skip
    assert {row["manufacturer"] for row in found} == {"Apple"}
    assert len(find(client, maker="Apple")) == 50


@pytest.mark.parametrize(
    ("query", "manufacturer", "model"),
    [
        ({"maker": "OnePlus", "search": "CPH2449"}, "OnePlus", "CPH2449"),
        ({"search": "Sony Ericsson Xperia Neo"}, "Sony Ericsson", "Xperia Neo"),
        ({"search": "pixel 9"}, "Google", "Pixel 9"),
    ],
)
def test_a_name_that_its_maker_might_give_is_offered(
    client: Client, query: dict[str, str], manufacturer: str, model: str
) -> None:
    assert {"manufacturer": manufacturer, "model": model, "name": model} in find(client, **query)


@pytest.mark.parametrize("search", ["visit my site", "Pixel visit my site", "%", "'"])
def test_other_words_find_nothing(client: Client, search: str) -> None:
    assert find(client, search=search) == []


def test_every_choice_is_a_model_that_rules_know(client: Client) -> None:
    for row in (
        *find(client, maker="apple"),
        *find(client, search="galaxy"),
        *find(client, search="pixel 9"),
    ):
        stated = {name: row[name] for name in ("manufacturer", "model")}

        assert identify(browser_document(**stated)).named, row
        assert identify(browser_document(**stated)).key == identify(device_document(**stated)).key


def test_nothing_is_found_where_nothing_is_asked_and_long_words_are_refused(client: Client) -> None:
    assert find(client) == []
    refused = client.get(f"{API}/models", {"search": "x" * 101})
    assert (refused.status_code, refused.json()["field"]) == (400, "search")
