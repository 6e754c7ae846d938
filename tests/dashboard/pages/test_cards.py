"""The pictures that links to pages are shown with."""

import io
import re
from dataclasses import replace
from typing import Any

import pytest
from django.test import Client
from PIL import Image, ImageDraw

from crowd.dashboard.figures.card import BOTTOM, HEIGHT, MOST_BARS, WIDTH, Card, plain, png
from crowd.dashboard.figures.palette import LIGHT
from crowd.dashboard.views import cards
from crowd.records.speedup import Speedup
from crowd.results.reading.queries.filters import SpeedupFilters
from crowd.results.reading.rows import DeviceDetail
from crowd.results.reading.selectors import Speedups
from tests.builders.measuring import measure
from tests.builders.rows import speedup
from tests.builders.stored import join

pytestmark = [pytest.mark.django_db, pytest.mark.usefixtures("session")]


def picture(card: Card) -> Image.Image:
    return Image.open(io.BytesIO(png(card))).convert("RGB")


def colours(image: Image.Image, height: int) -> set[tuple[int, ...]]:
    """Colours of the row of pixels at `height`."""
    return {image.getpixel((x, height)) for x in range(image.width)}  # type: ignore[misc]


BEST = tuple(bytes.fromhex(LIGHT.best[1:]))


def test_a_card_has_the_size_that_is_announced() -> None:
    assert picture(Card("title", "6.19x", "note")).size == (WIDTH, HEIGHT)


@pytest.mark.parametrize("rank", [0, 1, MOST_BARS * 3 + 1])
def test_the_device_that_a_card_is_about_is_lit_among_any_number(rank: int) -> None:
    bars = tuple(9 - number / 500 for number in range(MOST_BARS * 3 + 2))

    assert BEST in colours(picture(Card("title", "", "note", bars, rank)), BOTTOM - 8)


def test_a_long_note_goes_on_in_a_second_line_and_ends_with_dots_in_that() -> None:
    long = (
        "Simulated, not measured. Suspect: no session is valid. Geometric mean, 1,234 sessions, 95 % interval"
    )

    assert png(Card("title", "6.19x", f"{long} 1x")) != png(Card("title", "6.19x", f"{long} 2x"))
    assert png(Card("title", "6.19x", f"{long} " * 3)) == png(Card("title", "6.19x", f"{long} " * 4))


def test_a_long_text_is_cut_where_the_card_ends_after_few_looks(monkeypatch: pytest.MonkeyPatch) -> None:
    measured = []
    real = ImageDraw.ImageDraw.textlength

    def textlength(draw: ImageDraw.ImageDraw, text: str, *arguments: Any) -> float:
        measured.append(text)
        return real(draw, text, *arguments)

    monkeypatch.setattr(ImageDraw.ImageDraw, "textlength", textlength)

    assert png(Card("a" * 4000, "6.19x", "note")) == png(Card("a" * 90, "6.19x", "note"))
    assert png(Card("i" * 4000, "6.19x", "note")) != png(Card("i" * 90, "6.19x", "note"))
    assert len(measured) < 100
    assert max(map(len, measured)) <= WIDTH


def test_a_long_figure_is_written_smaller_instead_of_cut() -> None:
    question = "How fast on yours?"

    assert png(Card("title", question, "note")) != png(Card("title", f"{question[:-1]}!", "note"))


def test_signs_that_the_font_lacks_are_written_with_letters() -> None:
    assert (
        plain("5.84\u20136.55\u00d7, 95\u202f% of Xiaomi Poco \u00e5 \u5c0f")
        == "5.84-6.55x, 95 % of Xiaomi Poco a ?"
    )


def test_a_text_of_several_lines_is_written_in_one() -> None:
    assert png(Card("title", "6.19x", "note", scope="a\nb")) == png(
        Card("title", "6.19x", "note", scope="a b")
    )


def test_pages_name_a_picture_of_their_current_figure(client: Client) -> None:
    for address in ("/", "/devices/google-pixel-8/", "/about/"):
        page = client.get(address).content.decode()
        (image,) = re.findall(r'property="og:image" content="http://testserver([^"]+)"', page)
        (title,) = re.findall(r'property="og:title" content="([^"]+)"', page)
        assert f"<title>{title}</title>" in page
        answer: Any = client.get(image)
        assert (answer["Content-Type"], answer.content[:4]) == ("image/png", b"\x89PNG"), address
        assert client.get(image, headers={"If-None-Match": answer["ETag"]}).status_code == 304


def test_a_card_changes_with_its_figure(client: Client) -> None:
    before = client.get("/card.png")["ETag"]

    measure(join(), best_us=5_000)

    assert client.get("/card.png")["ETag"] != before
    assert client.get("/devices/unknown/card.png").status_code == 404


def test_a_card_is_kept_until_a_figure_changes_and_is_asked_about_each_time(
    client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = client.get("/card.png?vendor=Mali")
    assert first["Cache-Control"] == "no-cache"

    read = cards.results.speedups
    asked = []
    monkeypatch.setattr(cards.results, "speedups", lambda filters: asked.append(filters) or read(filters))
    assert client.get("/card.png?vendor=Mali")["ETag"] == first["ETag"]
    assert asked == []
    assert client.get("/card.png")["ETag"] != first["ETag"]
    assert len(asked) == 1


@pytest.mark.parametrize(
    ("query", "status", "noted"),
    [
        ("front=none", 404, "front=none"),
        ("application=none", 404, "application=none"),
        ("since=never", 400, "2026-11-30"),
        ("device=" + "a" * 4000, 400, "200 characters"),
        ("device=" + "+".join(map(str, range(60))), 400, "8 different words"),
    ],
)
def test_a_card_of_filters_that_mean_nothing_is_refused_as_figures_are(
    client: Client, query: str, status: int, noted: str
) -> None:
    for path in ("/card.png", "/figures/speedups.json"):
        answer = client.get(f"{path}?{query}")
        assert (answer.status_code, answer["Content-Type"]) == (status, "text/plain; charset=utf-8"), path
        assert noted in answer.content.decode()


def crowd(*rows: Speedup, **filters: Any) -> Speedups:
    asked = SpeedupFilters(**filters)
    return Speedups(asked, "kfusion-test", rows, ())


def test_a_card_says_what_it_is_about() -> None:
    slow = cards.of_crowd(
        crowd(speedup(0.5, configuration="accurate"), configuration="accurate", vendor="Mali")
    )

    assert slow.title == "Configuration accurate over default, on one device"
    assert slow.figure == "0.500\N{MULTIPLICATION SIGN} as fast"
    assert slow.scope == "configuration accurate, Arm Mali"
    assert png(slow) != png(replace(slow, scope=""))


def test_a_card_of_the_crowd_rests_on_confirmed_figures_and_counts_the_others(settings: Any) -> None:
    settings.FRONTRUNNER_QUORUM = 3
    rows = (
        speedup(23.0, "invented", confirmed=False),
        speedup(2.0, "phone"),
        speedup(9.0, "throttled", suspect=True),
    )

    mixed, none = cards.of_crowd(crowd(*rows)), cards.of_crowd(crowd(rows[0], rows[2]))

    assert mixed.title == "Tuned on one machine, on one device"
    assert (mixed.figure, mixed.bars) == ("2.00\N{MULTIPLICATION SIGN} faster", (2.0,))
    assert plain(mixed.note).endswith("Not in it: 1 unconfirmed device and 1 suspect device")
    assert (none.figure, none.bars) == ("How fast on yours?", ())
    assert plain(none.note) == (
        "Measured so far: 1 unconfirmed device and 1 suspect device. "
        "Three independent installations have to agree."
    )


def test_a_card_of_an_unconfirmed_device_has_no_figure(settings: Any) -> None:
    settings.FRONTRUNNER_QUORUM = 3
    row = speedup(23.0, "invented", confirmed=False)
    detail = DeviceDetail(row.device, (row,), (), 2, 1, None)

    card = cards.of_device(detail, crowd(row, speedup(2.0)))

    assert (card.figure, card.bars) == ("not confirmed yet", ())
    assert "23" not in card.note
    assert "Three independent installations have to agree" in card.note


def test_a_card_of_one_session_with_a_wide_interval_shows_the_range() -> None:
    row = speedup(11.1, "under-load", session_low=5.3, session_high=23.3)
    detail = DeviceDetail(row.device, (row,), (), 1, 1, None)

    card = cards.of_device(detail, crowd(row, speedup(2.0)))

    assert plain(card.figure) == "5.30-23.3x as fast"
    assert (card.bars, card.lit) == ((), None)
    assert "11.1" not in card.note


def test_a_card_of_a_private_server_says_so(settings: Any) -> None:
    for quorum, noted in ((1, True), (2, True), (3, False)):
        settings.FRONTRUNNER_QUORUM = quorum
        assert ("This server confirms" in cards.of_crowd(crowd(speedup())).note) is noted
