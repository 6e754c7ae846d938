"""The replay of early ends on stored runs."""

import pytest

from tests.benchmarks.stopping import SPACE, configurations, end_of, read, replay, summary, write


def row(number, error, time, frames=60):
    """A run whose error grows evenly to `error` (micrometres), each frame `time` microseconds."""
    configuration = SPACE.default if number == 0 else SPACE.decode(number)
    errors = [round(error * (frame + 1) / frames) for frame in range(frames)]
    run = {"errors": errors, "times": [round(time)] * frames, "process_seconds": 2.0, "device": "a"}
    return {"configuration": configuration} | run


def test_a_run_ends_after_the_first_frame_that_breaks_a_condition():
    assert end_of(row(1, 60_000, 1e4), [{"ate_max": 0.05}]) == (51, "limit")
    assert end_of(row(1, 600_000, 1e4), [{"ate_max": 0.05}]) == (25, "limit")
    assert end_of(row(1, 40_000, 1e4), [{"ate_max": 0.05}]) == (None, "")
    assert end_of(row(1, 60_000, 1e4), [{"ate_max": 0.03, "runtime": 0.009}]) == (31, "point")


def test_a_replay_learns_from_finished_runs_only():
    rows = [row(0, 20_000, 1e4), row(0, 20_000, 1.01e4), row(5, 400_000, 1e3), row(6, 30_000, 2e4)]
    ended, explorer = replay(rows, 0.05)
    assert [item.frames for item in ended] == [None, None, 25, 41]
    assert [item.by for item in ended] == ["", "", "limit", "point"]
    assert explorer.history.censored()[:, 0].tolist() == [False, True, True]
    assert [point for point, _ in explorer.front()] == [SPACE.default]
    text = "\n".join(summary(rows))
    assert "4 runs, 0 failed, 1 not valid, on a" in text
    assert "ended by a limit: 0 of 3; by a finished point: 1" in text
    assert "the front of 1 is the same" in text
    assert "frames of those not valid: 42 %" in text
    assert "frames of all: 78 %" in text


def test_more_samples_go_on_where_fewer_ended(tmp_path):
    few, many = [*configurations(3)], [*configurations(9)]
    assert few == many[: len(few)]
    assert few[0] == SPACE.default
    assert read(tmp_path / "none") == []
    write(tmp_path / "rows.json.gz", [row(0, 1, 1)])
    assert read(tmp_path / "rows.json.gz") == [row(0, 1, 1)]


@pytest.mark.parametrize("condition", [{"ate_max": 0.05}, {"ate_max": 0.0, "runtime": 0.0}])
def test_no_run_ends_before_its_time_is_known(condition):
    assert end_of(row(1, 900_000, 1e4, frames=25), [condition]) == (None, "")
