"""Pages and figures of searches."""

from typing import Any

import pytest
from django.test import Client

from crowd.dashboard.figures.explorations import exploration_plane
from crowd.dashboard.palette import LIGHT
from crowd.explorations.points import Point
from tests.dashboard.reading import read
from tests.dashboard.searches import KNOWN, exploration, measure


def point(ate: float, runtime: float, phase: str = "random", label: str = "") -> Point:
    return Point({"mu": 0.1}, label, phase, {"ate_max": ate, "runtime": runtime}, 1, 0)


@pytest.mark.django_db
def test_before_any_search_the_page_says_how_to_start_one(client: Client) -> None:
    page = read(client, "/explorations/")

    assert "This server has not explored anything itself" in page
    assert "manage.py explore" in page


@pytest.mark.django_db
def test_a_search_shows_what_it_measured_and_gained(client: Client, pack: dict[str, Any]) -> None:
    search = exploration(pack)
    measure(search, KNOWN)
    measure(search, [(0.03, 0.05), (0.049, 0.01), (0.5, 0.004), (0.01, 0.2)])

    listed = read(client, "/explorations/")
    page = read(client, f"/explorations/{search.pk}/")

    assert f"kfusion {search.pk} running" in listed
    assert "Configurations measured 8 in 8 measurements; 1 failed" in page
    assert "Valid among them 5" in page
    assert "On the front 5" in page
    assert "Fastest valid over the default, on the reference device 10.0x 10.0 ms a frame" in page
    assert "given failed - - - fast4 the process ended with signal 6" in page
    assert "8 random done 200 ms 1.00 cm" in page
    assert client.get(f"/figures/explorations/{search.pk}.json").json()["data"]


@pytest.mark.django_db
def test_a_search_that_has_measured_nothing_yet_has_a_page_without_a_chart(
    client: Client, pack: dict[str, Any]
) -> None:
    search = exploration(pack)

    response = client.get(f"/explorations/{search.pk}/")

    assert response.status_code == 200
    assert b"<figure" not in response.content
    assert "nothing valid yet" in read(client, f"/explorations/{search.pk}/")


@pytest.mark.django_db
def test_an_unknown_search_is_404(client: Client) -> None:
    assert client.get("/explorations/77/").status_code == 404
    assert client.get("/figures/explorations/77.json").status_code == 404


def test_phases_look_different_and_lie_under_the_front() -> None:
    points = [point(0.2, 0.1), point(0.1, 0.05, "active"), point(0.02, 0.2, "given", "default")]

    figure = exploration_plane(points, points[1:], 0.05, LIGHT)

    assert [trace.name for trace in figure.data] == [
        "random samples (1)",
        "active learning (1)",
        "known before (1)",
        "front (2)",
    ]
    assert len({trace.marker.symbol for trace in figure.data[:3]}) == 3
    assert [label.text for label in figure.layout.annotations] == ["default", "valid below 5 cm"]


def test_the_front_is_a_staircase_from_the_most_accurate_on() -> None:
    points = [point(0.04, 0.01), point(0.01, 0.1), point(0.02, 0.05)]

    (*_, stairs) = exploration_plane(points, points, 0.05, LIGHT).data

    assert (list(stairs.x), list(stairs.y)) == ([1.0, 2.0, 4.0], [100.0, 50.0, 10.0])
    assert stairs.line.shape == "hv"


def test_errors_beyond_the_axis_are_drawn_at_its_ends_and_told_in_full() -> None:
    (trace,) = exploration_plane([point(0.0, 0.1), point(31.0, 0.1)], [], 0.05, LIGHT).data

    assert list(trace.x) == [0.01, 100.0]
    assert "3,100.00" in trace.customdata[1]


def test_a_configuration_without_an_error_is_left_out() -> None:
    lost = Point({}, "", "random", {"runtime": 0.1}, 1, 0)

    assert not exploration_plane([lost], [], 0.05, LIGHT).data
