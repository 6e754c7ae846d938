"""The page of a front and its figure: the staircase, the crowd over it, names that do not overlap, bars."""

import json
import re
from collections.abc import Mapping
from itertools import combinations
from math import log10
from typing import Any

import numpy as np
import pytest
from django.test import Client
from hypothesis import given
from hypothesis import strategies as st

from crowd.dashboard.content.parameter_bars import Bar, Row, parameter_bars
from crowd.dashboard.content.parameter_meanings import meaning_of
from crowd.dashboard.content.points import MeasuredFront, MeasuredPoint
from crowd.dashboard.figures.elements import labels
from crowd.dashboard.figures.elements.labels import Plane, Side, Spot
from crowd.dashboard.figures.explorations import exploration_plane
from crowd.dashboard.figures.fronts import front_plane
from crowd.dashboard.figures.palette import LIGHT, THEMES, Theme
from crowd.dashboard.templatetags.pages import level
from crowd.explorations.outcomes.publishing import PROTOCOL
from crowd.explorations.searching import points as searches
from crowd.fronts.content.coverage import coverage, rectangle
from crowd.fronts.models import FrontVersion
from crowd.results.reading.queries.filters import SpeedupFilters
from crowd.results.reading.rows import Headline, ModelOutcomes
from crowd.results.reading.transferring import winners as transferring
from crowd.results.reading.transferring.rows import Winners
from tests.builders.known_front import known_front
from tests.builders.measuring import in_balanced_order, measure
from tests.builders.participant import Participant
from tests.builders.rows import front_of
from tests.builders.stored import join
from tests.dashboard.reading import read
from tests.shipped import FIXTURES
from wire.front import Content, Front, PackName, Point, Predicted

pytestmark = pytest.mark.django_db


def point(name: str, runtime: float | None, ate: float | None) -> Point:
    return Point(name, {"mu": 0.1}, Predicted(runtime or 0.0, ate, ate))


def mean(value: float, devices: int) -> Headline:
    return Headline(mean=value, low=value / 2, high=value * 2, devices=devices, unconfirmed=0)


def shown(points: list[Point], crowd: Mapping[str, Headline] | None = None) -> MeasuredFront:
    content = Content("kfusion", "1", PROTOCOL, PackName("", ""), tuple(points), {})
    front = Front("published", "", None, {}, content)
    filters = SpeedupFilters(front=front.slug)
    rows = [
        MeasuredPoint(one, None, None, (crowd or {}).get(one.name), ModelOutcomes(0, 0, 0)) for one in points
    ]
    area = rectangle(front)
    winners = Winners(filters, front.slug, "best", (), (), 0, 0, None, None, 0)
    return MeasuredFront(front, filters, tuple(rows), mean(1.0, 0), winners, area, coverage(front, area))


POINTS = [
    point("best", 0.005, 0.04),
    point("wild", 0.004, 0.2),
    point("front-01", 0.02, 0.02),
    point("beaten", 0.03, 0.03),
    point("accurate", 0.05, 0.01),
    point("default", 0.1, 0.02),
]


def traces(figure: Any) -> dict[str, Any]:
    return {trace.name: trace for trace in figure.data if trace.name}


def test_the_front_is_a_staircase_through_what_nothing_valid_beats() -> None:
    stairs = traces(front_plane(shown(POINTS), LIGHT))["staircase"]

    corners = list(zip(stairs.x, stairs.y, strict=True))
    assert corners[1:-1] == [(1.0, 50.0), (2.0, 50.0), (2.0, 20.0), (4.0, 20.0), (4.0, 5.0)]
    assert (corners[0][0], corners[-1][1]) == (1.0, 5.0)
    assert corners[0][1] > 100.0
    assert corners[-1][0] > 20.0


def test_points_that_are_beaten_or_not_valid_are_dimmed() -> None:
    drawn = traces(front_plane(shown(POINTS), LIGHT))

    assert sorted(drawn["on the front"].x) == [1.0, 2.0, 4.0]
    assert list(drawn["beaten by another"].x) == [3.0, 2.0]
    # The default is never pale: all others are compared with it.
    assert list(drawn["beaten by another"].marker.opacity) == [0.45, 1]
    assert (drawn["not valid"].marker.symbol, list(drawn["not valid"].marker.opacity)) == ("x", [0.45])


def test_the_crowd_is_drawn_over_the_reference_and_fewer_devices_are_marked() -> None:
    crowd = {"best": mean(10.0, 83), "accurate": mean(4.0, 28), "front-01": mean(5.0, 83)}

    drawn = traces(front_plane(shown(POINTS, crowd), LIGHT))

    most, few = drawn["mean of the crowd, 83 devices"], drawn["mean of the crowd, 28 devices"]
    # 100 ms of the default over ten times, at the error of the reference device.
    assert sorted(zip(most.x, most.y, strict=True)) == [(2.0, 20.0), (4.0, 10.0)]
    assert (most.marker.symbol, few.marker.symbol) == ("diamond", "diamond-tall")
    assert (list(few.y), list(few.error_y.array), list(few.error_y.arrayminus)) == ([25.0], [25.0], [12.5])
    assert "n = 28" in few.customdata[0]


def test_the_plane_is_logarithmic_and_holds_all_that_is_drawn() -> None:
    layout = front_plane(shown(POINTS, {"best": mean(2.0, 3)}), LIGHT).layout

    assert (layout.xaxis.type, layout.yaxis.type) == ("log", "log")
    assert layout.xaxis.range[0] < log10(1.0) < log10(20.0) < layout.xaxis.range[1]
    assert layout.yaxis.range[0] < log10(4.0) < log10(100.0) < layout.yaxis.range[1]
    assert [shape.x0 for shape in layout.shapes] == [5.0]


def test_what_has_a_name_of_its_own_is_named() -> None:
    written = [note.text for note in front_plane(shown(POINTS), LIGHT).layout.annotations]

    proper = ["default", "best", "accurate", "beaten", "wild"]
    assert written == ["valid below 5 cm", *proper, "front-01"]
    numbered = [f"probe-0{number}" for number in range(1, 8)]
    assert labels.labelled_names([*numbered, "knee", "best"], "probe-02") == ["best", "probe-02", "knee"]


def test_numbered_points_are_named_where_there_are_few() -> None:
    assert labels.labelled_names(["front-01", "knee", "best"]) == ["best", "knee", "front-01"]


def test_a_name_gives_way_to_one_that_has_a_single_free_side() -> None:
    # Left of "knee" is the only free side of it, where the staircase does not pass.
    stairs = Plane((1.0, 6.0), (2.0, 20.0), 350.0).line([(1.2, 20.0), (1.2, 5.1), (1.3, 5.1), (1.3, 4.5)])
    plane = Plane((1.0, 6.0), (2.0, 20.0), 350.0)
    best, knee = plane.spot("best", 1.3, 4.5), plane.spot("knee", 1.2, 5.1)

    sides = labels.place([best, knee], [best, knee], plane.height, stairs)

    assert not any(side.leader for side in sides.values())


@pytest.mark.parametrize("theme", THEMES.values(), ids=THEMES)
def test_what_has_no_prediction_is_left_out(theme: Theme) -> None:
    assert not front_plane(shown([]), theme).data
    assert not front_plane(shown([point("lost", 0.01, None), point("untold", None, 0.1)]), theme).data


def box(spot: Spot, side: Side, width: float, height: float) -> tuple[float, float, float, float]:
    """Left, right, bottom and top of a name in a plane of that size, in pixels."""
    wide, line = labels.LETTER * len(spot.name), labels.LINE
    left = spot.across * width + side.xshift - {"left": 0.0, "center": 0.5, "right": 1.0}[side.xanchor] * wide
    below = {"bottom": 0.0, "middle": 0.5, "top": 1.0}[side.yanchor] * line
    bottom = spot.up * height + side.yshift - below
    return left, left + wide, bottom, bottom + line


SPOTS = st.lists(
    st.tuples(st.floats(0, 1), st.floats(0, 1), st.integers(1, 12)), min_size=1, max_size=12
).map(lambda rows: [Spot(f"{n:02}"[:2].ljust(w, "x"), x, y) for n, (x, y, w) in enumerate(rows)])


HEIGHT = 350.0


@given(SPOTS, st.floats(*labels.WIDTHS), st.floats(labels.LOW, HEIGHT))
def test_names_never_overlap_nor_leave_the_plane_whatever_its_size(
    spots: list[Spot], width: float, height: float
) -> None:
    spots = list({spot.name: spot for spot in spots}.values())

    sides = labels.place(spots, spots, HEIGHT)

    boxes = [box(spot, sides[spot.name], width, height) for spot in spots if spot.name in sides]
    assert boxes
    for left, right, bottom, top in boxes:
        assert left >= -1e-6
        assert right <= width + 1e-6
        assert bottom >= -1e-6
        assert top <= height + 1e-6
    for one, other in combinations(boxes, 2):
        across = min(one[1], other[1]) - max(one[0], other[0])
        up = min(one[3], other[3]) - max(one[2], other[2])
        assert min(across, up) <= 1e-6


def covered(figure: Any, width: float, height: float) -> list[tuple[str, float, float]]:
    """Names of points in the JSON of `figure` that cover a mark, with the mark's place, in such a plane."""
    document = json.loads(figure.to_json())
    (x0, x1), (y0, y1) = (document["layout"][axis]["range"] for axis in ("xaxis", "yaxis"))
    marks = [
        ((log10(x) - x0) / (x1 - x0) * width, (log10(y) - y0) / (y1 - y0) * height)
        for trace in document["data"]
        if "markers" in trace.get("mode", "")
        for x, y in zip(trace["x"], trace["y"], strict=True)
    ]
    found = []
    for note in document["layout"]["annotations"]:
        if note.get("xref") != "x domain":
            continue
        right, up = (note["ax"], -note["ay"]) if note["showarrow"] else (note["xshift"], note["yshift"])
        side = Side(note["xanchor"], note["yanchor"], right, up)
        left, end, bottom, top = box(Spot(note["text"], note["x"], note["y"]), side, width, height)
        found += [
            (note["text"], x, y) for x, y in marks if left - 5 < x < end + 5 and bottom - 5 < y < top + 5
        ]
    return found


SHIPPED = [json.loads(path.read_text()) for path in sorted((FIXTURES / "fronts").glob("*.json"))]


@pytest.mark.parametrize("width", [310.0, 640.0, 1100.0])
@pytest.mark.parametrize("document", [*SHIPPED, known_front()], ids=lambda document: document["version"])
def test_no_name_of_a_front_covers_a_mark(document: dict[str, Any], width: float) -> None:
    front = front_of(document)
    crowd = {point.name: mean(1.3 + number, 5) for number, point in enumerate(front.points)}
    crowd.pop("default")

    figure = front_plane(shown(list(front.points), crowd), LIGHT)

    named = {note.text for note in figure.layout.annotations}
    assert {"default", "best", "accurate"} <= named
    assert not covered(figure, width, HEIGHT)


@pytest.mark.parametrize("width", [640.0, 1100.0])
def test_no_name_of_an_exploration_covers_a_mark(width: float) -> None:
    """Where named points are on the front, at the edge of a cloud of others. Made up."""
    cloud = 0.02 * np.random.default_rng(3).lognormal(sigma=0.6, size=(100, 2))
    error, runtime = cloud.min(axis=0).tolist()
    named = {"accurate": (error, 0.02), "best": (0.008, 0.008), "fast1": (0.021, runtime)}
    points = [
        searches.Point({}, label, "given", {"ate_max": ate, "runtime": runtime}, 1, 0)
        for label, (ate, runtime) in named.items()
    ]
    points += [
        searches.Point({}, "", "random", {"ate_max": ate, "runtime": runtime}, 1, 0)
        for ate, runtime in cloud.tolist()
    ]

    figure = exploration_plane(points, points[: len(named)], 0.05, LIGHT)

    assert set(named) <= {note.text for note in figure.layout.annotations}
    assert not covered(figure, width, 378.0)


def test_a_name_keeps_off_other_points_where_there_is_room() -> None:
    spot = Spot("best", 0.5, 0.5)

    assert labels.place([spot], [spot], 350)["best"].xanchor == "left"
    crowded = Plane((1.0, 10.0), (1.0, 10.0), 350).line([(10**0.5, 10**0.5), (10.0, 10**0.5)])
    beside = labels.place([spot], [spot, *crowded], 350)["best"]
    assert beside.yanchor != "middle" or beside.xanchor == "right"


def test_bars_are_sorted_by_time_and_rank_the_values_that_occur() -> None:
    rows = [
        Row("default", 0.1, 0.01, {"mu": 0.1, "rate": 1, "kind": "a"}),
        Row("untold", None, None, {"mu": 0.3, "kind": "a"}),
        Row("best", 0.01, 0.02, {"mu": 0.2, "rate": 20, "kind": "a"}),
    ]

    bars = parameter_bars(rows, rows[0].parameters)

    assert [row.name for row, _ in bars.rows] == ["best", "default", "untold"]
    assert (bars.names, bars.same) == (("mu", "rate"), {"kind": "a"})
    assert [cells for _, cells in bars.rows] == [
        (Bar("0.2", 67, 33, False), Bar("20", 100, 50, False)),
        (Bar("0.1", 33, 33, True), Bar("1", 50, 50, True)),
        (Bar("0.3", 100, 33, False), None),
    ]


def test_one_configuration_is_set_beside_the_default() -> None:
    (_, (bar,)) = parameter_bars([Row("", 0.1, 0.01, {"mu": 0.1})], {"mu": 0.4}).rows[0]

    assert bar == Bar("0.1", 50, 100, False)
    assert level(bar) == '<rect width="50%" height="100%"/><line x1="100%" x2="100%" y2="100%"/>'
    assert level(Bar("0.1", 50, None, False)) == '<rect width="50%" height="100%"/>'
    assert parameter_bars([Row("", 0.1, 0.01, {"mu": 0.1})], None).same == {"mu": 0.1}


def test_a_front_covers_a_share_of_the_rectangle_up_to_the_limit_and_the_default() -> None:
    alone = shown([point("best", 0.01, 0.02), point("default", 0.1, 0.04)])
    two = shown([point("best", 0.01, 0.02), point("accurate", 0.02, 0.01), point("default", 0.1, 0.04)])

    assert alone.rectangle == ((0.02, 0.01), (0.05, 0.1))
    assert alone.covered == pytest.approx(1.0)
    missing = log10(2) * log10(2) / (log10(5) * log10(10))
    assert two.covered == pytest.approx(1 - missing)


@pytest.mark.parametrize(
    "points",
    [
        [],
        [point("default", 0.1, 0.02)],
        [point("best", 0.01, 0.02)],
        [point("default", 0.1, 0.02), point("best", 0.01, 0.06)],
        [point("default", None, None), point("best", 0.01, 0.02)],
    ],
)
def test_without_anything_faster_than_the_default_and_valid_there_is_no_share(points: list[Point]) -> None:
    assert (shown(points).rectangle, shown(points).covered) == (None, None)


def test_a_front_that_nobody_measured_says_what_to_do(client: Client, front: FrontVersion) -> None:
    page = client.get("/fronts/kfusion-test/").content.decode()

    assert "This front has not been measured yet" in page
    assert '<a href="/measure/">measure it on your device</a>' in page
    assert "The crowd has no confirmed figure" in page


def test_what_few_readers_need_is_behind_a_word_to_press(client: Client, front: FrontVersion) -> None:
    """The answer, the chart and the table are not. A version that was asked for is shown at once."""
    page = client.get("/fronts/kfusion-test/").content.decode()
    asked = client.get("/fronts/kfusion-test/?against=kfusion-test").content.decode()

    further = "".join(re.findall(r'<details class="further">.*?\n</div>\n</details>', page, re.DOTALL))
    for name, folded in (
        *(("accurate-and-fast", False), ("plane", False), ("points", False)),
        *(("winners", True), ("parameters", True), ("provenance", True), ("protocol", True)),
    ):
        assert f'id="{name}"' in page
        assert (f'id="{name}"' in further) == folded, name
    assert '<details class="further" open>' in asked


def test_filters_that_leave_nobody_say_so_with_a_way_back(client: Client, participant: Participant) -> None:
    measure(participant)

    page = client.get("/fronts/kfusion-test/?vendor=NVIDIA").content.decode()

    assert "No device under these filters (NVIDIA) has measured this front" in page
    assert '<a href="/fronts/kfusion-test/">show all</a>' in page


def test_figures_over_fewer_devices_than_others_say_so(client: Client, front: FrontVersion) -> None:
    runs = in_balanced_order({"default": 80_000, "best": 10_000, "accurate": 20_000})
    measure(join(), "Pixel 8", runs=runs)
    measure(join(), "Pixel 7", best_us=10_000)

    page = read(client, "/fronts/kfusion-test/")

    assert "8.00x (7.77-8.25x) 8.00x 2 0" in page
    assert "1 of 2 0" in page
    assert "Where n is less than 2, the mean is over other devices than elsewhere." in page


def test_what_the_fastest_gains_over_best_is_of_the_devices_with_both(
    client: Client, front: FrontVersion, monkeypatch: pytest.MonkeyPatch
) -> None:
    both = {"default": 80_000, "best": 60_000}
    monkeypatch.setattr(transferring, "fastest_on_reference", lambda _: "accurate")
    for model, third_us in (("Pixel 8", 20_000), ("Pixel 7", 30_000)):
        measure(join(), model, runs=in_balanced_order(both | {"accurate": third_us}))
    # In the mean of best, but without a figure of the other.
    measure(join(), "Pixel 6", runs=in_balanced_order(both))

    page = read(client, "/fronts/kfusion-test/").replace("\N{NO-BREAK SPACE}", " ")
    assert "accurate is 2.45x as fast as best on the same device" in page
    assert "over 2 devices with confirmed figures of both, from 2.00x to 3.00x" in page
    every = client.get("/fronts/kfusion-test/").content.decode()
    assert 'href="/devices/?front=kfusion-test&amp;configuration=accurate"' in every


def test_the_figure_and_its_numbers_follow_the_filters(client: Client, front: FrontVersion) -> None:
    measure(join(), "Pixel 8", best_us=20_000)

    (best,) = [
        row
        for row in client.get("/tables/fronts/kfusion-test.json").json()["rows"]
        if row["configuration"] == "best"
    ]
    other = client.get("/tables/fronts/kfusion-test.json?vendor=NVIDIA").json()["rows"]

    assert (best["crowd_speedup"], best["crowd_devices"]) == (pytest.approx(4.0), 1)
    assert {row["crowd_speedup"] for row in other} == {None}
    names = [
        trace.get("name", "") for trace in client.get("/figures/fronts/kfusion-test.json").json()["data"]
    ]
    assert "mean of the crowd, 1 device" in names
    assert (
        'data-figure="/figures/fronts/kfusion-test.json?vendor=NVIDIA"'
        in client.get("/fronts/kfusion-test/?vendor=NVIDIA").content.decode()
    )


def test_a_meaning_ends_with_its_unit() -> None:
    assert meaning_of("mu") == "truncation distance of the signed distance field (m)"
    assert meaning_of("integration_rate") == "every n-th frame is fused into the volume"
    assert meaning_of("block") == ""


def test_pages_of_the_front_and_of_the_data_say_what_parameters_mean(
    client: Client, front: FrontVersion
) -> None:
    of_front = client.get(f"/fronts/{front.slug}/").content.decode()
    data = client.get("/data/").content.decode()

    assert f'title="{meaning_of("volume_resolution")}"' in of_front
    assert "truncation distance of the signed distance field" in data
