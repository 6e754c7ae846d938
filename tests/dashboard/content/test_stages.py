from dataclasses import replace

import numpy as np
import pytest

from crowd.dashboard.content.race import MOST_BLOCKS, WIDTH, race
from crowd.dashboard.content.stages import Tracking, frames, spread, stage_table, stage_times, tracking
from tests.builders.rows import run


def test_stages_follow_the_pipeline_and_acquisition_is_not_computation() -> None:
    series = run(stages={"raycasting": 0.5, "acquisition": 0.9, "loop closure": 0.1, "preprocessing": 0.4})

    (row,) = stage_times([series], first_counted=10)

    assert list(row.seconds) == ["preprocessing", "raycasting", "loop closure"]


def test_runs_of_one_configuration_are_averaged_over_counted_frames() -> None:
    slow_start = run(seconds=0.1)
    slow_start.stage_seconds["tracking"][:10] = 99.0

    (row,) = stage_times([slow_start, run(seconds=0.3)], first_counted=10)

    assert row.runs == 2
    assert row.computation == pytest.approx(0.2)
    assert row.seconds["tracking"] == pytest.approx(0.06)


def test_a_run_that_failed_early_or_without_stages_is_left_out() -> None:
    assert stage_times([run(frames=7), run(stages={})], first_counted=10) == ()


def test_a_failed_run_does_not_count_however_many_frames_it_has() -> None:
    """A run that lost the camera in most frames has the times of all of them."""
    lost = run("best", seconds=0.9, status="failed", state="invalid", reason="failed")

    (row,) = stage_times([lost, run("best", seconds=0.1)], first_counted=10)

    assert row.runs == 1
    assert row.computation == pytest.approx(0.1)
    assert stage_times([lost], first_counted=10) == ()


def test_the_table_compares_default_with_best_stage_by_stage_and_can_be_turned() -> None:
    times = stage_times([run("default", 0.1), run("best", 0.01, {"tracking": 0.6, "raycasting": 0.4})], 10)

    table = stage_table(times)

    assert table.configurations == ("default", "best")
    rows = {row.stage: row for row in table.rows}
    assert rows["tracking"].speedup == pytest.approx(5.0)
    assert rows["preprocessing"].seconds[1] is None
    assert rows["preprocessing"].speedup is None
    assert table.total.speedup == pytest.approx(10.0)
    turned = dict(table.transposed)
    assert turned["default"] == pytest.approx((0.02, 0.03, 0.05, 0.1))
    assert turned["best"] == (None, pytest.approx(0.006), pytest.approx(0.004), pytest.approx(0.01))


def test_without_a_default_nothing_is_compared() -> None:
    table = stage_table(stage_times([run("best", 0.01)], 10))

    assert not table.compared
    assert table.total.speedup is None


def test_spread_shares_add_up_to_the_computation() -> None:
    rows = spread(run(), first_counted=10)

    assert sum(row.share for row in rows) == pytest.approx(1.0)
    assert [row.least for row in rows] == pytest.approx([row.most for row in rows])


def test_frames_say_whether_they_count() -> None:
    series = run(frames=12)

    rows = frames(series, first_counted=10)

    assert [row.counted for row in rows] == [False] * 10 + [True] * 2
    assert rows[0].tracked is None
    assert np.isclose(sum(rows[11].stages), rows[11].seconds)
    empty = run(frames=0)
    assert (spread(empty, 10), frames(empty, 10)) == ((), ())


@pytest.mark.parametrize(
    ("tracked", "tried", "lost", "first", "every"),
    [
        ((None, True, True, True), 3, 0, 1, 1),
        ((None, None, True, None, False, None, True), 3, 1, 2, 2),
        ((None, True, None, None, True, None, None, True), 3, 0, 1, 3),
        ((True, True, None, True), 3, 0, 0, None),
        ((None, True), 1, 0, 1, None),
    ],
)
def test_tracking_says_on_which_frames_the_camera_was_tracked(
    tracked: tuple[bool | None, ...], tried: int, lost: int, first: int, every: int | None
) -> None:
    series = replace(run(frames=len(tracked)), tracked=tracked)

    assert tracking(series) == Tracking(len(tracked), tried, lost, first, every)


def test_tracking_is_not_known_where_the_client_did_not_tell() -> None:
    assert tracking(run()) is None


def test_both_lanes_take_the_same_time() -> None:
    lanes = race(6.2)

    assert lanes is not None
    default, best = lanes
    assert (default.frames, best.frames) == (4, pytest.approx(24.8))
    assert len(best.blocks) == 25
    for lane in lanes:
        last = lane.blocks[-1]
        assert WIDTH - 5 <= last.x + last.width <= WIDTH
    slower = race(0.5)
    assert slower is not None
    assert slower[1].frames == 2


@pytest.mark.parametrize("speedup", [1.0, 9.7, 35.0, 59.0])
def test_blocks_stay_apart_on_a_phone(speedup: float) -> None:
    lanes = race(speedup)

    assert lanes is not None
    assert max(len(lane.blocks) for lane in lanes) <= MOST_BLOCKS


@pytest.mark.parametrize("speedup", [None, 0.0, -1.0, float("nan")])
def test_without_a_speedup_there_is_no_race(speedup: float | None) -> None:
    assert race(speedup) is None
