"""A run ends early only where its whole result would be beyond a condition, too."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from slam import isolated, stopping
from slam.benchmark import Report, run
from slam.cli.arguments import condition
from slam.datasets import open_sequence
from slam.isolated import MeasurementError, bounds, combine, read_report
from slam.stopping import EarlyStop, Stop
from slam.validity import Verdict
from tests.slam.tiny import FRAMES, write_tiny_pack
from wire.protocol import VALID_BELOW

LIMIT = [{"ate_max": 0.05}]


def poses(count: int, step: float = 0.0) -> NDArray[np.float64]:
    """Poses that move by `step` metres a frame."""
    moved = np.tile(np.eye(4), (count, 1, 1))
    moved[:, 0, 3] = step * np.arange(count)
    return moved


def ended(conditions: Sequence[Mapping[str, float]], frames: int = 30, **changes: Any) -> Stop | None:
    """What ends a run of 100 frames after `frames` of them, each 1 cm further off, that take 10 ms each."""
    early = EarlyStop(conditions, 100, changes.get("truth", poses(100)), changes.get("timed", True))
    return early.after(list(poses(frames, 0.01)), [0.01] * (frames - 10))


def test_an_error_that_is_certainly_above_the_limit_ends_a_run() -> None:
    assert ended(LIMIT) == Stop(30, 100, "the largest error is above 5 cm")
    assert ended([{"ate_max": 0.3}]) is None


def test_no_run_ends_before_its_time_is_known_nor_after_its_last_frame() -> None:
    assert ended(LIMIT, 24) is None
    assert ended(LIMIT, 25) is not None
    assert ended(LIMIT, 100) is None


def test_a_time_ends_a_run_only_where_it_is_far_above() -> None:
    assert ended([{"runtime": 0.0097}]) is None
    assert ended([{"runtime": 0.0095}]) == Stop(30, 100, "a frame takes more than 9.5 ms")
    assert ended([{"runtime": 0.0095}], timed=False) is None


def test_a_finished_point_ends_a_run_that_is_behind_it_in_both() -> None:
    assert ended([{"ate_max": 0.02, "runtime": 0.009}]) is not None
    assert ended([{"ate_max": 0.02, "runtime": 0.011}]) is None
    assert ended([{"ate_max": 0.35, "runtime": 0.009}]) is None


def test_without_a_final_truth_only_the_time_ends_a_run() -> None:
    assert ended(LIMIT, truth=None) is None
    assert ended(LIMIT, truth=np.full((100, 4, 4), np.nan)) is None
    assert ended([{"runtime": 0.001}], truth=None) is not None


@pytest.mark.parametrize("text", ["0.05", "ate_mean=1", "ate_max=far", "ate_max=1,", "runtime=inf"])
def test_a_condition_names_an_error_or_a_time(text: str) -> None:
    with pytest.raises(Exception, match=r"write ate_max|convert|inf"):
        condition(text)
    assert condition("ate_max=0.05,runtime=0.2") == {"ate_max": 0.05, "runtime": 0.2}


@pytest.fixture(scope="module")
def reports(tmp_path_factory: pytest.TempPathFactory) -> tuple[Report, Report]:
    """Of a whole run, and of one that stopped: here short sequences may, too."""
    sequence = open_sequence(write_tiny_pack(tmp_path_factory.mktemp("sequences")))
    configuration = {"volume_resolution": 32, "compute_size_ratio": 4}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stopping, "FIRST_STOP", 11)
        stopped = run(configuration, sequence, stop_above=[{"ate_max": 0.0}])
    return run(configuration, sequence), stopped


def test_a_run_reports_where_it_ended_and_why(reports: tuple[Report, Report]) -> None:
    whole, report = reports
    assert whole.stop is None
    assert "stopped" not in whole.to_dict()
    assert whole.ate is not None
    assert report.ate is not None
    np.testing.assert_allclose(report.ate.per_frame, whole.ate.per_frame[:11], atol=1e-6)
    reason = "the largest error is above 0 cm"
    assert report.to_dict()["stopped"] == {"frames": 11, "wanted": FRAMES, "reason": reason}
    assert len(report.frames) == len(report.poses) == len(report.timestamps) == 11
    assert report.ate.max < VALID_BELOW
    assert report.verdict == Verdict(None, f"stopped after 11 of {FRAMES} frames: {reason}")


def test_a_measurement_that_stopped_has_bounds_of_its_errors(reports: tuple[Report, Report]) -> None:
    whole, stopped = (read_report(report.to_dict()) for report in reports)
    assert [part["stopped_at"] for part in (*whole.parts, *stopped.parts)] == [None, 11]
    errors = [name for name in whole.objectives if name.startswith("ate_")]
    assert len(errors) == 4
    assert all(stopped.objectives[name] <= whole.objectives[name] + 1e-6 for name in errors)
    assert {*errors, "runtime_max"} <= set(bounds(stopped.parts, 1))
    assert "runtime" not in bounds(stopped.parts, 1)
    assert bounds(whole.parts, 1) == []


def part(error: float, stopped_at: int | None = None) -> dict[str, Any]:
    return {"sequence": "a", "lost": 0, "stopped_at": stopped_at, "ate_max": error, "runtime": 0.1}


@pytest.mark.parametrize(
    ("parts", "ignored", "bound"),
    [
        ([part(0.1), part(0.2), part(0.3)], 0, False),
        ([part(0.1), part(0.2)], 0, True),  # the third was not run
        ([part(0.1), part(0.2, 25), part(0.3)], 0, True),  # it may be above 0.3
        ([part(0.1), part(0.2), part(0.3, 25)], 1, False),  # the largest is ignored, whatever it is
        ([part(0.1), part(0.2, 25), part(0.3)], 1, True),
        ([part(0.1), part(0.2)], 1, True),
    ],
)
def test_an_error_is_a_bound_where_what_is_not_known_could_change_it(
    parts: list[dict[str, Any]], ignored: int, bound: bool
) -> None:
    assert bounds(parts, 3, ignored) == ["ate_max"] * bound
    assert combine(parts, ignored)["ate_max"] in (0.1, 0.2, 0.3)


def test_a_system_that_corrects_its_poses_has_no_error_once_it_stopped() -> None:
    stop = {"frames": 25, "wanted": 100, "reason": "a frame takes more than 10 ms"}
    report = {"ate": {"max": 0.01}, "ate_online": {"max": 0.01}, "frames": [{}], "stopped": stop}
    report |= {"not_valid_because": None, "valid": None}
    with pytest.raises(
        MeasurementError, match="stopped after 25 of 100 frames: a frame takes more than 10 ms"
    ):
        isolated.read_report(report)
