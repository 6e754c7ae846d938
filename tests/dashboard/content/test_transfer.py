"""Whether the front transfers: figures, numbers and words from rows, and the page."""

from typing import Any

import numpy as np
import pytest
from django.test import Client

from crowd.dashboard.content.transfer import PEARSON, SPEARMAN, ordered, pairs, similarities
from crowd.dashboard.drawings.transfer import Map, map_table, winners_table
from crowd.dashboard.figures.palette import LIGHT
from crowd.dashboard.figures.transfer import correlation_map, regret_bars, winner_bars
from crowd.fronts.models import FrontVersion
from crowd.results.reading.queries.filters import SpeedupFilters
from crowd.results.reading.transferring.rows import CorrelationMatrix, Winner, Winners
from tests.builders.measuring import in_balanced_order, measure
from tests.builders.rows import device
from tests.builders.stored import join
from tests.dashboard.reading import read

NAN = float("nan")
# Microseconds a frame, with the two that every front has.
THREE = {"default": 80_000, "best": 60_000}


def winner(slug: str, name: str, regret: float | None, rank: int | None) -> Winner:
    best = None if regret is None else 6.0 / regret
    return Winner(device(slug), "opencl", "Mali", 5, name, 6.0, best, rank, regret, 2)


ROWS = (winner("far", "fast", 1.5, 3), winner("here", "best", 1.0, 1), winner("lost", "fast", None, None))
FOUND = Winners(
    SpeedupFilters(), "kfusion-test", "best", ROWS, (("fast", 2), ("best", 1)), 2, 1, 1.25, 0.5, 0
)
MATRIX = CorrelationMatrix(
    filters=SpeedupFilters(),
    front="kfusion-test",
    devices=(device("a"), device("b"), device("c"), device("alone")),
    sessions=(3, 2, 1, 1),
    pearson=np.array([[NAN, 0.9, 0.4, NAN], [0.9, NAN, 0.6, NAN], [0.4, 0.6, NAN, NAN], [NAN] * 4]),
    spearman=np.array([[NAN, 1.0, -0.5, NAN], [1.0, NAN, 0.8, NAN], [-0.5, 0.8, NAN, NAN], [NAN] * 4]),
    common=np.full((4, 4), 5),
    left_out=0,
    unconfirmed=0,
)


def test_losses_are_sorted_and_winners_are_marked_and_counted_with_best_in_its_colour() -> None:
    bars, marks = regret_bars(ROWS, "best", LIGHT).data

    assert list(bars.y) == [0.0, 0.5]
    assert [address for _, address in bars.customdata] == ["/devices/here/", "/devices/far/"]
    assert list(marks.x) == [0]
    assert "rank 3 of 5" in bars.customdata[1][0]
    (counts,) = winner_bars(FOUND.counts, LIGHT).data
    assert list(counts.x) == [2, 1]
    assert list(counts.marker.color) == [LIGHT.series[0], LIGHT.best]
    # Devices whose best has no valid figure come last.
    assert [row.device.slug for row in ordered(ROWS)] == ["here", "far", "lost"]
    assert winners_table(FOUND).rows[-1][-4:-1] == (None, None, None)


def test_the_map_shows_the_coefficient_asked_for_and_blanks_what_is_unknown() -> None:
    (cells,) = correlation_map(MATRIX, SPEARMAN, LIGHT).data

    assert list(cells.z[0]) == [None, 1.0, -0.5, None]
    assert (cells.zmin, cells.zmax) == (-0.5, 1)
    assert "n = 5" in cells.customdata[0][1]
    assert correlation_map(MATRIX, PEARSON, LIGHT).data[0].z[0][1] == 0.9


def test_axes_have_names_and_a_phone_has_fewer_and_shorter_ones() -> None:
    many = tuple(
        winner(f"phone-{number:02}-of-a-long-name", "fast", 1 + number / 100, 2) for number in range(80)
    )

    layout = regret_bars(many, "best", LIGHT).layout
    map_layout = correlation_map(MATRIX, PEARSON, LIGHT).layout

    wide, narrow = layout.xaxis.ticktext, layout.meta["narrow"]["xaxis.ticktext"]
    assert len(wide) > len(narrow) > 5
    assert max(map(len, narrow)) <= 12 < max(map(len, wide))
    assert map_layout.xaxis.ticktext == map_layout.yaxis.ticktext == ("A", "B", "C", "Alone")
    assert map_layout.meta["narrow"]["yaxis.ticktext"] == ["A", "B", "C", "Alone"]


def test_devices_without_a_common_configuration_get_words_instead_of_a_map() -> None:
    empty = CorrelationMatrix(
        SpeedupFilters(), None, (), (), np.empty((0, 0)), np.empty((0, 0)), np.empty((0, 0), int), 0, 0
    )

    figure = correlation_map(empty, PEARSON, LIGHT)

    assert not figure.data
    assert "Too few devices" in figure.layout.annotations[0].text


def test_each_pair_counts_once_and_each_device_says_whom_it_is_least_like() -> None:
    assert sorted(pairs(MATRIX, PEARSON)) == [0.4, 0.6, 0.9]
    rows = similarities(MATRIX, PEARSON)
    assert [row.device.slug for row in rows] == ["a", "b", "c"]
    assert (rows[0].median, rows[0].least, rows[0].least_with.slug) == (pytest.approx(0.65), 0.4, "c")
    assert len(map_table(Map(MATRIX, PEARSON)).rows) == 6


@pytest.mark.django_db
def test_before_anybody_measured_several_the_page_says_how_to(client: Client, front: FrontVersion) -> None:
    page = read(client, "/transfer/")

    assert "This is not known yet" in page
    assert "--configurations all" in page


@pytest.mark.django_db
def test_the_page_answers_in_a_sentence_with_its_n(client: Client, front: FrontVersion) -> None:
    for model, third_us in (("Pixel 8", 50_000), ("Pixel 7", 75_000)):
        names = {"default": 80_000, "best": 60_000, "accurate": third_us}
        measure(join(), model, runs=in_balanced_order(names))

    page = read(client, "/transfer/?correlation=spearman")

    assert "On 1 of 2 devices" in page
    assert "it takes 1.10x the time" in page
    assert "times correlate with 0.50 (Spearman, median of 1 pair of devices)" in page
    assert "Google Pixel 8 1.33x 2 of 3 accurate 1.60x 1.20x" in page
    answer = client.get("/tables/transfer/best.json").json()
    assert [row["reference_rank"] for row in answer["rows"]] == [1, 2]


@pytest.mark.django_db
def test_unconfirmed_devices_are_counted_and_decide_nothing(
    client: Client, front: FrontVersion, settings: Any
) -> None:
    settings.FRONTRUNNER_QUORUM = 2
    for _ in range(2):
        measure(join(), "Pixel 8", runs=in_balanced_order(THREE | {"accurate": 75_000}))
    measure(join(), "Pixel 7", runs=in_balanced_order(THREE | {"accurate": 50_000}))

    page = read(client, "/transfer/").replace("\N{NO-BREAK SPACE}", " ")
    period = client.get("/tables/transfer/winners.json?since=2026-11-01").json()

    assert "the fastest configuration on the reference device, is the fastest one as well" in page
    assert "Not in it: 1 device that measured three configurations" in page
    assert "Pixel 7" not in page
    assert period["n"] == "1 device; not shown: 1 unconfirmed device"
    assert [row["device"] for row in period["rows"]] == ["google-pixel-8"]
