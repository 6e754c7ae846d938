"""Pages and the API say the same number, of the same devices."""

import math
import re
from collections.abc import Iterator
from html import unescape
from typing import Any

import pytest
from django.test import Client

from crowd.dashboard import formats
from crowd.dashboard.views.cards import of_crowd
from crowd.fronts.publishing.services import publish_content
from crowd.results.reading import selectors
from crowd.results.reading.queries.filters import SpeedupFilters
from tests.builders.documents import front_document
from tests.builders.measuring import measure
from tests.builders.stored import join
from tests.dashboard.conftest import Filling

pytestmark = [pytest.mark.django_db, pytest.mark.usefixtures("crowd")]
# Parts of a page whose numbers are not figures: how to take part, axes, sizes of files, the citation's date.
ASIDE = "|".join(
    (
        r'<section class="invitation.*?</section>',
        r'<text class="tick.*?</text>',
        r'<details class="take">.*?</details>',
        r'<section[^>]*class="cite".*?</section>',
    )
)
# The level of intervals.
CONSTANTS = {"95"}
SIGNS = {"\N{NARROW NO-BREAK SPACE}": " ", "\N{NO-BREAK SPACE}": " "}


@pytest.fixture(scope="module")
def crowd(filling: Filling) -> None:
    """Three models, one of them measured by three installations."""
    with filling() as pack:
        publish_content(front_document(pack))
        for best_us in (9_000, 10_000, 12_000):
            measure(join(), "Pixel 8", best_us=best_us)
        measure(join(), "Pixel 7", best_us=23_000)
        measure(join(), "Pixel 6", best_us=41_000)


def answers(client: Client) -> list[Any]:
    paths = ("speedups", "speedups?configuration=all", "sessions", "fronts", "fronts/kfusion-test", "devices")
    return [client.get(f"/api/v1/{path}").json() for path in paths]


def values(answer: Any) -> Iterator[Any]:
    """All strings and numbers in `answer`, and how many rows its lists have."""
    if isinstance(answer, dict):
        for member in answer.values():
            yield from values(member)
    elif isinstance(answer, list):
        yield len(answer)
        for member in answer:
            yield from values(member)
    elif answer is not None and not isinstance(answer, bool):
        yield answer


def written(number: float) -> set[str]:
    """How pages may write `number`."""
    ways = [formats.significant(number), f"{number:g}", f"{number * 100:g}", formats.centimetres(number)]
    ways += [formats.milliseconds(number), formats.frames_per_second(number or None), f"{number:,}"]
    return {way.split(formats.GAP)[0].replace(formats.TIMES, "") for way in ways}


def numbers(html: str, names: set[str]) -> list[str]:
    """The numbers that a reader of `html` sees, without those within `names`."""
    (title,), (main,) = (
        re.findall(r"<title>(.*?)</title>", html)[:1],
        re.findall(r"<main.*?</main>", html, re.S),
    )
    words = " ".join([title, re.sub(ASIDE, " ", main, flags=re.S)])
    words = unescape(re.sub(r"<title>.*?</title>|<[^>]+>", " ", words, flags=re.S))
    for sign, plain in SIGNS.items():
        words = words.replace(sign, plain)
    for name in sorted(names, key=len, reverse=True):
        words = words.replace(name, " ")
    return re.findall(r"\d[\d,]*(?:\.\d+)?", words)


@pytest.mark.parametrize("address", ["/", "/fronts/"])
def test_every_number_of_a_page_is_in_the_api(client: Client, address: str) -> None:
    known = [value for answer in answers(client) for value in values(answer)]
    names = {value for value in known if isinstance(value, str) and value}
    hours = {formats.hour(session.started_at) for session in selectors.latest_sessions()}
    days = {name[:10] for name in names if re.match(r"\d{4}-\d\d-\d\d", name)}
    titles = {row.device.title for row in selectors.devices()}
    figures = client.get("/api/v1/speedups").json()["results"]
    allowed = CONSTANTS.union(*(written(value) for value in known if not isinstance(value, str)))
    allowed.add(str(sum(row["sessions"] for row in figures)))

    shown = numbers(client.get(address).content.decode(), names | hours | days | titles)

    assert len(shown) >= 1
    assert [number for number in shown if number not in allowed] == []


def test_title_headline_card_and_citation_read_the_headline_of_the_api(client: Client) -> None:
    summary = client.get("/api/v1/speedups").json()["summary"]
    headline = summary["headline"]
    value = formats.speedup(headline["value"])
    page = unescape(client.get("/").content.decode())
    plain = re.sub(r"\s+", " ", re.sub(r"<[^>]+>", "", page.replace("\N{NO-BREAK SPACE}", " ")))

    assert headline["models"] == summary["devices"] == 3
    assert f"<title>{value} over 3\N{NO-BREAK SPACE}devices" in page
    assert f"{value} faster across 3 devices" in plain
    assert f"front kfusion-test: {value} over 3 device models." in plain
    assert of_crowd(selectors.speedups(SpeedupFilters())).figure == f"{value} faster"
    assert f"{value} in the mean" in client.get("/embed/speedups/").content.decode()


def test_the_geometric_mean_is_that_of_the_models_that_are_counted(client: Client) -> None:
    answer = client.get("/api/v1/speedups").json()
    product = math.prod(row["speedup"] for row in answer["results"])

    assert answer["summary"]["devices"] == len(answer["results"]) == 3
    assert answer["summary"]["geometric_mean"] == pytest.approx(product ** (1 / 3))


def test_a_front_says_the_figures_of_its_configurations_as_the_api_does(client: Client) -> None:
    page = client.get("/fronts/kfusion-test/").content.decode()
    text = " ".join(unescape(re.sub(r"<[^>]+>", " ", page)).split())

    summary = client.get("/api/v1/speedups?front=kfusion-test&configuration=best").json()["summary"]
    tried = summary["attempted"]
    failed = f"{summary['failing']} of {tried} {summary['losing']} of {tried}"
    counts = f"{summary['devices']} {summary['unconfirmed']} {failed}"
    assert f"{formats.speedup(summary['headline']['value'])} {counts}" in text
