"""Devices side by side."""

import pytest
from django.test import Client

from tests.builders.measuring import measure
from tests.builders.stored import join
from tests.dashboard.reading import read, text

pytestmark = [pytest.mark.django_db, pytest.mark.usefixtures("session")]


def test_devices_stand_side_by_side(client: Client) -> None:
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


def test_configurations_of_one_device_stand_side_by_side(client: Client) -> None:
    page = read(client, "/compare/?configurations=default,best&device=google-pixel-8")

    assert "Speedup 1.00x 8.00x" in page
    assert "Time a frame 80.0 ms, 12.5 fps 10.0 ms, 100 fps" in page
    # Of the parameters, only those that differ.
    assert "volume resolution 256 128" in page
    assert "icp threshold" not in page
    answer = client.get("/tables/compare.json?configurations=default,best&device=google-pixel-8").json()
    assert [row["configuration"] for row in answer["rows"]] == ["default", "best"]


NUMBER = "ame 2 to 6 devices to compare"


@pytest.mark.parametrize(
    ("query", "words"),
    [
        ("device=google-pixel-8&configurations=best", "ame 2 to 6 configurations to compare, not best"),
        (
            "device=google-pixel-8&configurations=best,unheard",
            "has no configuration unheard: choose from default, best, accurate",
        ),
        ("devices=a", NUMBER),
        ("devices=a,b,c,d,e,f,g", NUMBER),
        ("devices=a,a", NUMBER),
    ],
)
def test_what_cannot_be_compared_is_named_with_what_would_be_right(
    client: Client, query: str, words: str
) -> None:
    response = client.get(f"/compare/?{query}")

    assert response.status_code == 400
    assert words in text(response)


def test_a_comparison_with_an_unknown_device_is_404(client: Client) -> None:
    assert client.get("/compare/?devices=google-pixel-8,unknown").status_code == 404
