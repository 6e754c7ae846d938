"""Figures of searches, drawn from points that are made up for testing."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from crowd.dashboard.figures.elements.decimation import MOST_DRAWN, decimate, decimation_note
from crowd.dashboard.figures.explorations import (
    exploration_plane,
    growth_line,
    importance_bars,
    prediction_plane,
)
from crowd.dashboard.figures.palette import LIGHT
from crowd.explorations.searching.points import Point
from pareto.surrogates.prediction import Prediction


def point(ate: float, runtime: float, phase: str = "random", label: str = "") -> Point:
    return Point({"mu": 0.1}, label, phase, {"ate_max": ate, "runtime": runtime}, 1, 0)


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
    assert [label.text for label in figure.layout.annotations] == ["valid below 5 cm", "default"]


def test_the_front_is_a_staircase_from_the_most_accurate_on() -> None:
    points = [point(0.04, 0.01), point(0.01, 0.1), point(0.02, 0.05)]

    (*_, stairs) = exploration_plane(points, points, 0.05, LIGHT).data

    assert (list(stairs.x), list(stairs.y)) == ([1.0, 2.0, 4.0], [100.0, 50.0, 10.0])
    assert stairs.line.shape == "hv"


def test_errors_beyond_the_axis_are_drawn_at_its_ends_and_points_without_one_are_left_out() -> None:
    (trace,) = exploration_plane([point(0.0, 0.1), point(31.0, 0.1)], [], 0.05, LIGHT).data

    assert list(trace.x) == [0.01, 100.0]
    assert [row[1] for row in trace.customdata] == ["", "over "]
    without = Point({}, "", "random", {"runtime": 0.1}, 1, 0)
    assert not exploration_plane([without], [], 0.05, LIGHT).data


def test_of_very_many_points_a_selection_is_drawn_and_the_figure_says_so() -> None:
    points = [point(0.01, 0.01 + 1e-6 * number) for number in range(2 * MOST_DRAWN)]
    points[1] = point(0.01, 0.2, "given", "default")

    figure = exploration_plane(points, [], 0.05, LIGHT)

    assert sum(len(trace.x) for trace in figure.data) == MOST_DRAWN + 1
    assert figure.data[0].name == f"random samples ({2 * MOST_DRAWN - 1:,})"
    assert "5,001 of 10,000 points drawn" in [label.text for label in figure.layout.annotations]


@given(st.integers(0, 60), st.integers(1, 20), st.sets(st.integers(0, 59)))
def test_a_selection_keeps_what_it_must_and_the_order(number: int, most: int, kept: set[int]) -> None:
    drawn = decimate(range(number), kept.__contains__, most)

    assert drawn == sorted(drawn)
    assert kept & set(range(number)) <= set(drawn)
    assert len(set(drawn) - kept) <= most
    assert len(drawn) == number or number > most
    assert decimation_note(len(drawn), number) == (
        "" if len(drawn) == number else f"{len(drawn)} of {number} points drawn"
    )


def test_hovering_tells_every_parameter_of_a_point_of_the_front() -> None:
    (trace,) = exploration_plane(
        [], [Point({"mu": 0.1, "<b>": 2}, "", "random", {"ate_max": 1, "runtime": 1}, 1, 0)], 0.05, LIGHT
    ).data

    assert "mu %{customdata[3]}<br>&lt;b&gt; %{customdata[4]}" in trace.hovertemplate
    assert list(trace.customdata[0][3:]) == ["0.1", "2"]


def test_the_growth_is_a_staircase_in_per_cent_that_says_where_learning_began() -> None:
    figure = growth_line([0.0, 0.5, 0.5, 1.0], 2, LIGHT)

    assert list(figure.data[0].y) == [0.0, 50.0, 50.0, 100.0]
    assert [label.text for label in figure.layout.annotations] == ["active learning begins"]
    assert not growth_line([0.0, 1.0], 2, LIGHT).layout.shapes


@pytest.mark.parametrize("count", [1, 2, 3])
def test_few_results_have_axes_around_them(count: int) -> None:
    points = [point(0.020, 0.1), point(0.021, 0.11), point(0.022, 0.09)][:count]

    shown = exploration_plane(points, points[:1], 0.05, LIGHT).layout

    (left, right), (low, high) = ((10.0**a, 10.0**b) for a, b in (shown.xaxis.range, shown.yaxis.range))
    assert left < 2.0 < 5.0 < right < 10.0
    assert 40.0 < low < 90.0 < 110.0 < high < 250.0
    assert len(shown.xaxis.ticktext) >= 3
    assert len(shown.yaxis.ticktext) >= 3
    (marks,) = growth_line([0.4], 1, LIGHT).data
    assert marks.mode == "markers"
    assert list(growth_line([0.4], 1, LIGHT).layout.xaxis.range) == [0, pytest.approx(5.1)]


def test_a_long_growth_is_drawn_by_its_corners() -> None:
    growth = np.repeat(np.arange(10.0), MOST_DRAWN).tolist()

    (line,) = growth_line(growth, 0, LIGHT).data

    assert len(line.x) == 11
    assert (line.x[-1], line.y[-1]) == (10 * MOST_DRAWN, 900.0)


def test_what_matters_most_stands_on_top_and_equals_in_the_order_of_names() -> None:
    shares = {
        "runtime": {"mu": 0.1, "volume_resolution": 0.7},
        "ate_max": {"mu": 0.9, "volume_resolution": 0.2},
    }

    figure = importance_bars(shares | {"cpu_seconds": None}, LIGHT)

    assert [list(bar.y) for bar in figure.data] == [["volume resolution", "mu"]] * 2
    assert list(figure.data[1].x) == [20.0, 90.0]
    equal = {f"parameter_{letter}": 0.0 for letter in "fcadeb"}
    (bar,) = importance_bars({"runtime": equal}, LIGHT).data
    assert list(bar.y) == [f"parameter {letter}" for letter in "abcdef"]


def test_predictions_are_drawn_in_the_units_of_the_pages() -> None:
    prediction = Prediction(np.arange(2), np.array([0.01, 0.02]), np.array([0.02, 0.02]), 0.5, 0.1, log=True)

    diagonal, marks = prediction_plane("runtime", prediction, LIGHT).data

    assert list(diagonal.x) == list(diagonal.y) == [10.0, 20.0]
    assert (list(marks.x), list(marks.y)) == ([10.0, 20.0], [20.0, 20.0])
