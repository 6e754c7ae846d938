"""How a visitor gets from the home page to measuring: a button, a QR code, commands, a link to the source."""

from typing import Any

import pytest
from django.test import Client

from crowd.dashboard.templatetags.pages import qr_code
from crowd.fronts.models import FrontVersion

pytestmark = pytest.mark.django_db
BUTTON = '<a class="call" href="/measure/">Measure this device</a>'


def home(client: Client, **options: Any) -> str:
    return client.get("/", **options).content.decode()


def test_the_home_page_begins_with_the_button_that_measures_and_phones_need_https(
    client: Client, front: FrontVersion
) -> None:
    content = home(client).partition("<main")[2]

    assert content.count(BUTTON) == 1
    assert content.index("<h1") < content.index(BUTTON) < content.index("Speedup by device")
    assert "qr-code" not in content
    assert "Without HTTPS, browsers measure only" in content


def test_without_a_front_there_is_nothing_to_measure(client: Client) -> None:
    assert BUTTON not in home(client)


def test_a_secure_page_has_the_link_as_a_qr_code(client: Client, front: FrontVersion) -> None:
    page = home(client, secure=True)

    assert str(qr_code("https://testserver/measure/")) in page
    assert "Without HTTPS, browsers measure only" not in page


def test_a_qr_code_holds_its_address_in_its_squares_alone() -> None:
    svg = str(qr_code("https://frontrunner.example/measure/"))

    assert svg.startswith("<svg ")
    assert "style" not in svg
    assert "example" not in svg
    assert svg != str(qr_code("https://another.example/measure/"))


def test_the_source_is_linked_where_the_deployment_says_where_it_is(
    client: Client, front: FrontVersion, settings: Any
) -> None:
    settings.FRONTRUNNER_SOURCE = "https://example.org/frontrunner"
    assert '<a href="https://example.org/frontrunner">Source</a>' in home(client)

    settings.FRONTRUNNER_SOURCE = ""
    assert "Source</a>" not in home(client)


@pytest.mark.parametrize("address", ["/", "/devices/", "/fronts/", "/data/", "/about/"])
def test_pages_without_charts_do_not_load_the_plot_library(
    client: Client, front: FrontVersion, address: str
) -> None:
    assert b"plotly" not in client.get(address).content
