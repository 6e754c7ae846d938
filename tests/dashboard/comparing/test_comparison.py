"""Devices side by side."""

from collections.abc import Callable

import pytest
from django.test import Client

from crowd.fronts.models import FrontVersion
from tests.builders.measuring import measure
from tests.builders.participant import Participant
from tests.dashboard.reading import read, text

pytestmark = pytest.mark.django_db


def test_devices_stand_side_by_side(
    client: Client, join: Callable[[], Participant], front: FrontVersion
) -> None:
    measure(join(), "Pixel 8", best_us=10_000)
    measure(join(), "Pixel 7", best_us=40_000)

    page = read(client, "/compare/?devices=google-pixel-8,google-pixel-7")

    assert "Speedup 8.00x 2.00x" in page
    assert "best 10.0 ms, 100 fps 40.0 ms, 25.0 fps" in page
    assert "n = 4 runs of 2 sessions" not in page
    assert "n = 8 runs of 2 sessions" in page
    ticked = read(client, "/compare/?devices=google-pixel-8&devices=google-pixel-7")
    assert ticked == page
    figure = client.get("/figures/compare.json?devices=google-pixel-8,google-pixel-7").json()
    assert [row["text"].split("  ")[1] for row in figure["layout"]["annotations"]] == [
        "default, Google Pixel 8",
        "best, Google Pixel 8",
        "default, Google Pixel 7",
        "best, Google Pixel 7",
    ]


def test_configurations_of_one_device_stand_side_by_side(client: Client, participant: Participant) -> None:
    measure(participant, default_us=80_000, best_us=10_000)

    page = read(client, "/compare/?configurations=default,best&device=google-pixel-8")

    assert "Speedup 1.00x 8.00x" in page
    assert "Time a frame 80.0 ms, 12.5 fps 10.0 ms, 100 fps" in page
    # Of the parameters, only those that differ.
    assert "volume resolution 256 128" in page
    assert "icp threshold" not in page
    answer = client.get("/tables/compare.json?configurations=default,best&device=google-pixel-8").json()
    assert [row["configuration"] for row in answer["rows"]] == ["default", "best"]


@pytest.mark.parametrize(
    ("query", "words"),
    [
        ("configurations=best", "ame 2 to 6 configurations to compare, not best"),
        ("configurations=best,unheard", "has no configuration unheard: choose from default, best, accurate"),
    ],
)
def test_configurations_that_cannot_be_compared_are_named(
    client: Client, participant: Participant, query: str, words: str
) -> None:
    measure(participant)

    response = client.get(f"/compare/?device=google-pixel-8&{query}")

    assert response.status_code == 400
    assert words in text(response)


@pytest.mark.parametrize("query", ["?devices=a", "?devices=a,b,c,d,e,f,g", "?devices=a,a"])
def test_a_comparison_of_too_few_or_too_many_says_what_would_be_right(client: Client, query: str) -> None:
    response = client.get(f"/compare/{query}")

    assert response.status_code == 400
    assert "ame 2 to 6 devices to compare" in text(response)


def test_a_comparison_with_an_unknown_device_is_404(client: Client, participant: Participant) -> None:
    measure(participant)

    assert client.get("/compare/?devices=google-pixel-8,unknown").status_code == 404
