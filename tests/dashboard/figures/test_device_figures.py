"""Figures of one device."""

from datetime import UTC, datetime
from typing import Any
from uuid import UUID

import pytest

from crowd.dashboard.content.drift import Readings, Step, readings, steps
from crowd.dashboard.figures.devices import (
    configuration_bars,
    crowd_bars,
    drift_steps,
    release_marks,
    sensor_lines,
)
from crowd.dashboard.figures.palette import DARK, LIGHT
from crowd.explorations.outcomes.publishing import PROTOCOL
from crowd.records.session import SessionRow
from crowd.results.reading.rows import Release, SessionDetail
from tests.builders.rows import crowd, device, run, speedup


def session(*runs: Any, samples: Any = ()) -> SessionDetail:
    moment = datetime(2026, 11, 20, tzinfo=UTC)
    row = SessionRow(
        uuid=UUID(int=1),
        device=device(),
        application="kfusion",
        front="kfusion-test",
        protocol_version=1,
        backend="opencl",
        processor="Mali",
        processor_class="gpu",
        started_at=moment,
        received_at=moment,
        summarised=True,
        speedups=(),
    )
    return SessionDetail(row, PROTOCOL, "", list(samples), tuple(runs))


def test_configurations_are_sorted_and_best_has_its_colour() -> None:
    rows = [speedup(3.0, configuration="best"), speedup(5.0, configuration="fast", low=4.0, high=7.0)]

    bars, whiskers, values = configuration_bars(rows, LIGHT).data

    assert list(bars.x) == [5.0, 3.0]
    assert list(bars.marker.color) == [LIGHT.series[0], LIGHT.best]
    assert (list(whiskers.x), list(whiskers.error_x.array)) == ([5.0], [2.0])
    assert list(values.x) == [7.0, 3.0]
    assert "95 % interval" in bars.customdata[0]
    assert "95 % interval" not in bars.customdata[1]


def test_a_device_is_lit_and_named_among_the_crowd() -> None:
    rows = [speedup(3.0, "mine"), speedup(9.0, "first"), speedup(1.0, "last")]
    ranking = crowd(*rows).ranking("mine")
    assert ranking is not None

    figure = crowd_bars(ranking, LIGHT)

    (bars,) = figure.data
    assert list(bars.y) == [9.0, 3.0, 1.0]
    assert list(bars.marker.color) == [LIGHT.default, LIGHT.best, LIGHT.default]
    (label,) = figure.layout.annotations
    assert (label.x, "this device" in label.text) == (2, True)


def test_releases_are_named_and_have_intervals_where_due() -> None:
    seen = datetime(2026, 11, 20, tzinfo=UTC)
    rows = [
        Release("r44p1", "15", 6.0, None, None, 2, 1, seen, seen),
        Release("r46", "", 8.0, 7.0, 9.0, 5, 3, seen, seen),
    ]

    figure = release_marks(rows, LIGHT)

    assert list(figure.data[0].x) == [6.0, 8.0]
    assert list(figure.data[1].error_x.array) == [1.0]
    assert [label.text.split("  ")[1] for label in figure.layout.annotations] == ["r44p1, 15", "r46"]


def test_drift_compares_each_run_with_the_first_of_its_configuration() -> None:
    measured = session(
        run("default", 0.1),
        run("best", 0.01, order=1),
        run("best", 0.012, order=2, repeat=1),
        run("default", 0.1, order=3, repeat=1),
    )

    drift = steps(measured)

    assert [(step.place, step.configuration, step.ratio) for step in drift] == [
        (1, "default", 1.0),
        (2, "best", 1.0),
        (3, "best", pytest.approx(1.2)),
        (4, "default", 1.0),
    ]
    lines = drift_steps(drift, DARK).data
    assert {line.name: list(line.x) for line in lines} == {"default": [1, 4], "best": [2, 3]}
    assert lines[1].y[1] == pytest.approx(20.0)


@pytest.mark.parametrize(
    "first",
    [
        run("best", frames=0),
        # A failed run does not count however many frames it has.
        run("best", 0.9, status="failed", state="invalid", reason="failed"),
    ],
)
def test_drift_is_that_over_the_first_run_with_frames_that_count(first: Any) -> None:
    runs = [first, run("best", 0.01, order=1, repeat=1), run("best", 0.012, order=2, repeat=2)]

    assert [(step.place, step.ratio) for step in steps(session(*runs))] == [(2, 1.0), (3, pytest.approx(1.2))]
    broken = run("best", frames=3)
    assert [step.configuration for step in steps(session(run("default"), broken))] == ["default"]


def test_sensors_with_fewer_than_two_values_are_left_out() -> None:
    samples: list[dict[str, object]] = [
        {"t": 0.0, "temperature_c": 31.0, "cpu_mhz": None, "battery": 80.0},
        {"t": 2.0, "temperature_c": 36.5, "cpu_mhz": 2400.0, "battery": None},
    ]

    assert readings(samples) == (Readings("temperature", "°C", (0.0, 2.0), (31.0, 36.5)),)
    assert readings([]) == ()


def test_a_clock_that_hardly_changes_is_drawn_flat() -> None:
    flat = Readings("processor clock", "MHz", (0.0, 1.0, 2.0), (2399.0, 2401.0, 2400.0))
    throttled = Readings("processor clock", "MHz", (0.0, 1.0), (2400.0, 1200.0))
    cold = Readings("battery", "%", (0.0, 1.0), (1.0, 0.0))

    ranges = [sensor_lines([each], LIGHT).layout.yaxis.range for each in (flat, throttled, cold)]

    assert ranges == [(2150.0, 2650.0), (1140.0, 2460.0), (0.0, 10.0)]


def test_of_many_configurations_the_drift_colours_default_and_best_and_names_the_farthest() -> None:
    names = ["default", "best", *(f"front-{number}" for number in range(6))]
    drift = [
        Step(index + 1, name, 0, 1.0 if index < 8 else 1.0 + index / 1000)
        for index, name in enumerate([*names, *names])
    ]

    figure = drift_steps(drift, LIGHT)

    lit = {trace.name: trace.line.color for trace in figure.data if trace.showlegend}
    assert lit == {"default": LIGHT.default, "best": LIGHT.best}
    assert {trace.line.color for trace in figure.data} == {LIGHT.default, LIGHT.best, LIGHT.muted}
    assert [trace.name for trace in figure.data][-2:] == ["default", "best"]
    (label,) = figure.layout.annotations
    assert (label.x, "front-5" in label.text) == (16, True)


def test_each_sensor_has_an_axis_of_its_own() -> None:
    battery = Readings("battery", "%", (0, 1), (80, 79))

    figure = sensor_lines([Readings("temperature", "°C", (0.0, 2.0), (31.0, 36.5)), battery], LIGHT)

    assert [trace.yaxis for trace in figure.data] == ["y", "y2"]
    assert figure.layout.yaxis.domain[0] > figure.layout.yaxis2.domain[1]
    assert figure.layout.xaxis.anchor == "y2"
