"""A front on one device as a figure and as numbers, from made-up expectations; limits that may be asked."""

from datetime import UTC, datetime
from typing import Any

import pytest

from crowd.dashboard.content.advice import Advice, AdviceRequest, DevicePrediction, Limits, Slider
from crowd.dashboard.drawings.predictions import points_table
from crowd.dashboard.figures.palette import LIGHT
from crowd.dashboard.figures.predictions import device_plane
from crowd.explorations.outcomes.publishing import PROTOCOL
from crowd.predictions.expectations import FrontPrediction, PredictedPoint
from crowd.predictions.selectors import PredictionResult
from crowd.predictions.tables import Group
from crowd.results.reading.queries.filters import InvalidFilterError
from tests.builders.rows import device
from wire.front import Content, Front, PackName


def point(
    name: str, ate_max: float | None, ratio: float, measured: bool = False, probe: bool = False
) -> PredictedPoint:
    low, high = (ratio, ratio) if name == "default" else (ratio / 2, ratio * 2)
    return PredictedPoint(
        configuration=name, parameters={"mu": 0.1}, ate_max=ate_max, ratio=ratio, low=low, high=high,
        measured=measured, probe=probe,
    )  # fmt: skip


POINTS = (
    point("default", 0.01, 1.0, measured=True),
    point("best", 0.03, 8.0, measured=True),
    point("knee", 0.02, 4.0),
    point("lost", None, 2.0),
    point("probe-01", 0.015, 3.0, probe=True),
)
CONTENT = Content("kfusion", "test", PROTOCOL, PackName("", ""), (), {})
FRONT = Front("published", "", None, {}, CONTENT)


def advice(limits: Limits | None = None, seconds: float | None = 0.08, points: Any = POINTS) -> Advice:
    expectation = FrontPrediction(points, (), seconds, "power", 3, 5)
    answer = PredictionResult(FRONT, Group(1, "opencl", "gpu"), device(), "Phone", expectation, ())
    return Advice.of(DevicePrediction(answer, datetime(2026, 11, 20, tzinfo=UTC)), limits or Limits())


def traces(shown: Advice) -> dict[str, Any]:
    return {trace.name: trace for trace in device_plane(shown, LIGHT).data}


def test_measured_points_are_filled_predicted_ones_hollow_with_intervals_and_probes_small_and_pale() -> None:
    found = traces(advice())

    measured, predicted = found["measured here"], found["predicted, 95 % interval"]
    assert (measured.marker.symbol, predicted.marker.symbol) == ("circle", "circle-open")
    assert measured.error_y.array is None
    assert (list(predicted.x), list(predicted.y)) == ([2.0], [20.0])
    # Half and twice the ratio are twice and half the time.
    assert (list(predicted.error_y.array), list(predicted.error_y.arrayminus)) == ([20.0], [10.0])

    probe, point = found["probe, predicted"].marker, found["predicted, 95 % interval"].marker
    assert probe.size < point.size
    assert probe.opacity < point.opacity


def test_the_recommended_point_is_marked_and_named_and_follows_the_limit() -> None:
    at_five, at_two = advice(), advice(Limits(0.02))

    assert list(traces(at_five)["recommended"].x) == [3.0]
    assert list(traces(at_two)["recommended"].x) == [2.0]
    words = [note.text for note in device_plane(at_two, LIGHT).layout.annotations]
    assert words == ["at most 2 cm", "default", "best", "knee", "probe-01"]


def test_without_a_time_of_the_default_ratios_are_drawn_and_it_has_no_interval() -> None:
    figure = device_plane(advice(seconds=None), LIGHT)

    assert "times as fast" in figure.layout.yaxis.title.text
    (predicted,) = [trace for trace in figure.data if trace.name == "predicted, 95 % interval"]
    assert (list(predicted.y), list(predicted.error_y.array)) == ([4.0], [4.0])

    unmeasured = advice(seconds=None, points=(point("default", 0.01, 1.0), *POINTS[2:]))
    (default,) = [trace for trace in device_plane(unmeasured, LIGHT).data if list(trace.y) == [1.0]]
    assert default.error_y.array is None
    assert not default.showlegend


def test_the_table_holds_every_point_in_si_units() -> None:
    table = points_table(advice(Limits(0.02)))

    rows = [dict(zip(table.columns, row, strict=True)) for row in table.rows]
    assert [row["configuration"] for row in rows] == [one.configuration for one in POINTS]
    assert [row["configuration"] for row in rows if row["recommended"]] == ["knee"]
    assert rows[2]["runtime_s"] == pytest.approx(0.02)
    assert (rows[1]["state"], rows[2]["state"], rows[4]["probe"]) == ("measured", "predicted", True)


def test_nothing_within_the_limits_is_marked_nowhere() -> None:
    shown = advice(Limits(0.001))

    assert "no configuration has an error of at most 0.001 m" in shown.problem
    assert "recommended" not in traces(shown)


def test_the_slider_begins_at_the_smallest_error_of_a_point_and_ends_at_five_centimetres() -> None:
    slider = Slider.over([point("a", 0.0087, 2.0), point("b", None, 2.0)], 0.05)

    assert (slider.least, slider.most, slider.value) == ("0.009", "0.05", "0.05")
    assert (Slider.over([], 0.1).most, Slider.over([point("a", 0.02, 2.0)], 0.004).least) == ("0.1", "0.004")


@pytest.mark.parametrize(
    "query", [{"max_ate": "much"}, {"max_ate": "-1"}, {"max_ms": "nan"}, {"gpu": "x" * 101}]
)
def test_what_cannot_be_asked_is_named(query: dict[str, str]) -> None:
    (name,) = query

    with pytest.raises(InvalidFilterError, match=name):
        AdviceRequest.of(query)


def test_a_question_has_one_shortest_address() -> None:
    asked = AdviceRequest.of({"model": "", "gpu": " Adreno 650 ", "max_ate": "0.050", "max_ms": "33"})

    assert asked.query == "gpu=Adreno+650&max_ms=33"
    assert asked.limits.options == "--max-ate 0.05 --max-ms 33"
