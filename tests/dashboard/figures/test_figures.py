"""Figures as pure functions: what rows become, without a server or a browser."""

import json
from dataclasses import replace

import numpy as np
import pytest

from crowd.dashboard.content.stages import StageTimes, stage_times
from crowd.dashboard.figures.elements import layout, marks
from crowd.dashboard.figures.elements.decimation import MOST_DRAWN
from crowd.dashboard.figures.elements.layout import log_ticks
from crowd.dashboard.figures.frames import frame_lines, frames_height, stage_areas, stage_bars
from crowd.dashboard.figures.palette import DARK, LIGHT, THEMES, Theme, mixed
from crowd.dashboard.figures.saving import LINE
from crowd.dashboard.figures.speedups import NAMED_BARS, SOC, bar_names, speedup_bars
from tests.builders.rows import RUN, device, run, speedup


def bars(rows: list, theme: Theme = LIGHT) -> list:
    return [trace for trace in speedup_bars(rows, theme).data if trace.type == "bar"]


def test_bars_are_sorted_and_lead_to_their_device() -> None:
    (trace,) = bars([speedup(3.0, "slow"), speedup(9.0, "fast"), speedup(5.0, "middle")])

    assert list(trace.x) == [9.0, 5.0, 3.0]
    assert [address.split("/")[2] for _, address in trace.customdata] == ["fast", "middle", "slow"]


def test_bars_of_one_family_share_a_colour_and_a_legend_entry() -> None:
    rows = [speedup(4.0, "a"), speedup(5.0, "b", processor="NVIDIA T4"), speedup(6.0, "c")]

    traces = bars(rows)

    assert {trace.name: list(trace.x) for trace in traces} == {"Mali": [6.0, 4.0], "NVIDIA": [5.0]}
    assert len({trace.marker.color for trace in traces}) == 2
    assert all(trace.showlegend for trace in traces)


def test_a_vendor_keeps_its_colour_whatever_the_filters_leave() -> None:
    rows = [speedup(4.0, "a"), speedup(5.0, "b", processor="NVIDIA T4"), speedup(6.0, "c", processor="x")]

    together = {trace.name: trace.marker.color for trace in bars(rows)}

    assert {trace.name: trace.marker.color for trace in bars(rows[:1])} == {"Mali": together["Mali"]}
    assert len(set(together.values())) == 3


def test_more_groups_than_colours_share_one_as_other() -> None:
    rows = [speedup(3.0, f"d{n}", device=device(f"d{n}", soc=f"SoC {n // 2}")) for n in range(20)]

    traces = [trace for trace in speedup_bars(rows, LIGHT, SOC).data if trace.type == "bar"]

    assert [trace.name for trace in traces] == [*(f"SoC {n}" for n in range(5)), "other"]
    assert len({trace.marker.color for trace in traces}) == 6
    assert sum(len(trace.x) for trace in traces) == 20


def test_only_due_intervals_get_whiskers() -> None:
    figure = speedup_bars([speedup(6.0, "a", low=5.0, high=8.0), speedup(3.0, "b")], LIGHT)

    (whiskers,) = [trace for trace in figure.data if trace.type == "scatter"]
    assert list(whiskers.x) == [6.0]
    assert (list(whiskers.error_x.arrayminus), list(whiskers.error_x.array)) == ([1.0], [2.0])


def test_suspect_figures_are_striped_and_say_so() -> None:
    (trace,) = bars([speedup(6.0, "a"), speedup(5.0, "b", suspect=True)])

    assert list(trace.marker.pattern.shape) == ["", "/"]
    assert "suspect" in trace.customdata[1][0]


def test_unconfirmed_figures_stand_hollow_behind_all_that_count_and_the_legend_says_so() -> None:
    rows = [speedup(23.0, "invented", confirmed=False), speedup(9.0, "hot", suspect=True), speedup(2.0, "a")]

    for theme in THEMES.values():
        (trace,) = bars(rows, theme)
        assert list(trace.x) == [2.0, 23.0, 9.0]
        assert list(trace.marker.pattern.shape) == ["", "", "/"]
        assert list(trace.marker.line.width) == [0, 1.5, 0]
        filled, hollow, _ = trace.marker.color
        assert hollow == mixed(filled, theme.surface, marks.INSIDE)
        legend = [other.name for other in speedup_bars(rows, theme).data if other.x == (None,)]
        assert legend == ["unconfirmed", "suspect"]
    assert "unconfirmed" in trace.customdata[1][0]
    assert "unconfirmed" not in trace.customdata[0][0]


def test_the_interval_of_one_session_is_grey_and_says_what_it_is() -> None:
    row = speedup(6.0, "b", confirmed=False, session_low=5.0, session_high=8.0)

    legend, over_installations, of_one = (
        trace for trace in speedup_bars([row], LIGHT).data if trace.type == "scatter"
    )

    assert "unconfirmed" in legend.name
    assert list(over_installations.x) == []
    assert (list(of_one.x), list(of_one.error_x.array)) == ([6.0], [2.0])
    assert of_one.error_x.color == LIGHT.muted
    (trace,) = bars([row])
    assert "95 % interval of one session 5.00" in trace.customdata[0][0]


def test_a_device_with_two_processors_has_two_names_also_where_drivers_call_them_the_same() -> None:
    rows = [speedup(6.0, processor="Mali-G78"), speedup(2.0, processor="pthread-cortex")]
    same = [speedup(6.0, processor="Apple M2"), speedup(2.0, processor="Apple M2", processor_class="cpu")]

    written = [annotation.text for annotation in speedup_bars(rows, LIGHT).layout.annotations]

    assert ["Phone (Mali-G78)" in written[0], "Phone (pthread-cortex)" in written[1]] == [True, True]
    assert bar_names(same) == ["Phone (GPU)", "Phone (CPU)"]


def test_of_many_devices_the_largest_the_smallest_and_the_mean_are_named() -> None:
    rows = [speedup(2.0 + number / 10, f"device-{number}") for number in range(NAMED_BARS + 1)]

    figure = speedup_bars(rows, LIGHT, mean=3.44)

    assert {trace.orientation for trace in figure.data if trace.type == "bar"} == {"v"}
    labels = {label.x: label.text for label in figure.layout.annotations}
    assert labels == {
        0: "<b>5.00\N{MULTIPLICATION SIGN}</b> largest, Device-30",
        NAMED_BARS: "<b>2.00\N{MULTIPLICATION SIGN}</b> smallest, Device-0",
        16: "<b>3.44\N{MULTIPLICATION SIGN}</b> mean",
    }
    assert figure.layout.height == 460


def test_labels_are_of_figures_that_count_and_above_every_bar() -> None:
    rows = [speedup(2.0 + number / 10, f"device-{number}") for number in range(NAMED_BARS + 1)]

    figure = speedup_bars([*rows, speedup(0.1, "invented", confirmed=False)], LIGHT, mean=3.44)

    assert all("Invented" not in label.text for label in figure.layout.annotations)
    assert min(label.y for label in figure.layout.annotations) > 5.0
    assert list(figure.layout.yaxis.tickvals) == [0, 1, 2, 3, 4, 5], "no number of the axis beside a label"
    assert figure.layout.yaxis.ticktext[-1] == "5\N{MULTIPLICATION SIGN}"
    levels = sorted(label.y for label in figure.layout.annotations)
    assert len(set(levels)) == 3
    pixels = 185 * (levels[1] - levels[0]) / figure.layout.yaxis.range[1]
    assert pixels > figure.layout.annotations[0].font.size * LINE, "in a figure for a column"


def test_of_more_bars_than_a_browser_draws_every_second_stands_for_all() -> None:
    rows = [speedup(1 + number / 1000, f"phone-{number}") for number in range(MOST_DRAWN + 2)]

    figure = speedup_bars(rows, LIGHT)

    values = [value for trace in figure.data if trace.type == "bar" for value in trace.y]
    assert len(values) == MOST_DRAWN // 2 + 1
    assert (max(values), min(values)) == (rows[-1].speedup, pytest.approx(rows[1].speedup))
    assert "2,501 of 5,002 points drawn" in figure.layout.xaxis.title.text


def test_a_name_that_a_client_sent_is_shown_and_not_interpreted() -> None:
    row = speedup(device=device("x", name="<b>bold</b> & co"))

    figure = speedup_bars([row], LIGHT)

    (trace,) = [trace for trace in figure.data if trace.type == "bar"]
    assert "&lt;b&gt;bold&lt;/b&gt; &amp; co" in trace.customdata[0][0]
    assert "&lt;b&gt;bold" in figure.layout.annotations[0].text


def test_lines_are_in_milliseconds_and_lead_to_their_run_and_frames_that_do_not_count_are_shaded() -> None:
    figure = frame_lines([run("default", 0.1), run("best", 0.01), run("best", 0.02, repeat=1)], 10, LIGHT)

    assert [trace.y[0] for trace in figure.data] == [100.0, 10.0, 20.0]
    assert [trace.showlegend for trace in figure.data] == [True, True, False]
    assert [trace.line.color for trace in figure.data] == [LIGHT.default, LIGHT.best, LIGHT.best]
    assert figure.data[0].customdata[0][1] == f"/runs/{RUN}/"
    assert figure.layout.yaxis.type == "log"
    (shade,) = figure.layout.shapes
    assert (shade.x0, shade.x1) == (-0.5, 9.5)


def test_of_many_configurations_each_has_a_row_with_the_fastest_on_top() -> None:
    names = ["default", "best", *(f"front-{number}" for number in range(5))]
    runs = [
        run(name, 0.1 - place / 100, repeat=repeat) for repeat in (0, 1) for place, name in enumerate(names)
    ]

    figure = frame_lines(runs, 10, LIGHT)

    _, single, means = figure.data
    assert list(figure.layout.yaxis.ticktext) == names[::-1]
    assert list(means.x) == pytest.approx([40, 50, 60, 70, 80, 90, 100])
    assert len(single.x) == 14
    assert list(means.marker.color)[-2:] == [LIGHT.best, LIGHT.default]
    assert figure.layout.height == frames_height(7) < 400


def test_frames_that_were_left_out_are_marks_of_their_own_below_the_axis_of_the_others() -> None:
    whole, half = run("default", 0.1), run("adaptive", 0.01)
    skipped = (np.arange(20) % 2 == 1) & (np.arange(20) > 4)
    half = replace(
        half,
        frame_seconds=np.where(skipped, 4e-6, half.frame_seconds),
        # The first three frames build the model.
        tracked=(None,) * 3 + tuple(None if one else True for one in skipped[3:]),
        skipped=0.5,
    )

    figure = frame_lines([whole, half], 10, LIGHT)

    _, line, strokes = figure.data
    assert [value for value in line.y if value is not None] == [10.0] * 12
    assert list(strokes.x) == list(range(5, 20, 2))
    low, high = figure.layout.yaxis.range
    assert 5.0 < 10**low < 10.0 < 100.0 < 10**high
    assert strokes.y[0] < (1.0 - low) / (high - low)


def test_times_that_hardly_differ_are_drawn_flat() -> None:
    axis = frame_lines([run("default", 0.1), run("best", 0.101)], 10, LIGHT).layout.yaxis

    assert 10 ** (axis.range[1] - axis.range[0]) == pytest.approx(1.5)
    assert frame_lines([run("default", 0.1), run("best", 0.01)], 10, LIGHT).layout.yaxis.range is None


def test_close_bars_of_stages_have_their_names_on_the_axis() -> None:
    rows = stage_times([run("default", 0.1), run("best", 0.02)], 10)

    figure = stage_bars(rows, LIGHT, close=True)

    assert figure.layout.yaxis.ticktext == ("default", "best")
    assert not figure.layout.annotations
    assert figure.layout.height < stage_bars(rows, LIGHT).layout.height


def test_stage_bars_stack_to_the_computation() -> None:
    rows = stage_times([run("default", 0.1), run("best", 0.02)], 10)

    figure = stage_bars(rows, LIGHT)

    assert figure.layout.barmode == "stack"
    assert [trace.name for trace in figure.data] == ["preprocessing", "tracking", "raycasting"]
    assert [sum(trace.x[rank] for trace in figure.data) for rank in (0, 1)] == pytest.approx([100, 20])


def test_what_lies_between_the_stages_has_a_bar_of_its_own() -> None:
    figure = stage_bars([StageTimes("best", 2, {"tracking": 0.006, "raycasting": 0.003}, 0.01)], LIGHT)

    assert [(trace.name, *trace.x) for trace in figure.data][-1] == ("rest", pytest.approx(1.0))


def test_a_run_without_stages_shows_its_computation() -> None:
    (trace,) = stage_areas(run(seconds=0.05, stages={}), 10, LIGHT).data

    assert (trace.name, trace.y[0]) == ("computation", 50.0)


def test_a_logarithmic_axis_has_ticks_between_values_that_are_nearly_the_same() -> None:
    assert layout.log_axis("", [51.4, 37.0])["ticktext"] == ["35", "40", "45", "50", "55"]
    assert log_ticks(0.3, 40.0) == pytest.approx([0.5, 1, 2, 5, 10, 20])
    assert log_ticks(2.0, 12.0) == pytest.approx([2, 3, 5, 7, 10])


@pytest.mark.parametrize("theme", THEMES.values(), ids=THEMES)
def test_no_rows_make_an_empty_figure(theme: Theme) -> None:
    for figure in (speedup_bars([], theme), frame_lines([], 10, theme), stage_bars([], theme)):
        assert not any(len(trace.x) for trace in figure.data)
    assert "No figure to show yet" in speedup_bars([], theme).layout.annotations[0].text


def test_figures_follow_the_theme() -> None:
    light, dark = (frame_lines([run("best")], 10, theme).to_json() for theme in (LIGHT, DARK))

    assert LIGHT.best in light
    assert DARK.best in dark
    assert LIGHT.best not in dark


def test_nothing_in_a_figure_needs_eval_or_webgl() -> None:
    figures = (
        speedup_bars([speedup()], LIGHT),
        frame_lines([run()], 10, LIGHT),
        stage_bars(stage_times([run()], 10), LIGHT),
        stage_areas(run(), 10, LIGHT),
    )

    kinds = {trace["type"] for figure in figures for trace in json.loads(figure.to_json())["data"]}
    assert kinds <= {"bar", "scatter"}
