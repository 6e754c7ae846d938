"""What is kept of a measurement, and which ones have failed."""

from collections.abc import Sequence
from typing import Any

import pytest

from client_kit.delivery.manifest import Manifest
from client_kit.measuring.run_record import recorded
from client_kit.measuring.session import Run
from client_kit.measuring.worker_client import Outcome
from tests.builders import manifests

STAGES = ("preprocessing", "tracking", "integration", "raycasting")
ASKED = Manifest.parse(manifests.manifest())
REFERENCE = [[0.0, 0.0, 0.0]] * 12


def run(
    tracked: Sequence[bool | None],
    worst: float = 0.01,
    stage: float | None = 0.0024999,
    positions: list[list[float]] = REFERENCE,
) -> Run:
    stages = dict.fromkeys(STAGES, stage)
    frames: list[dict[str, Any]] = [{"computation": 0.01, **stages, "tracked": value} for value in tracked]
    ate = {"max": worst, "mean": 0.005, "rmse": 0.006}
    return recorded("best", 1, 2, Outcome({"frames": frames, "ate": ate}, positions), REFERENCE)


def test_a_run_that_loses_the_camera_is_failed_and_keeps_its_times() -> None:
    lost, held = run([None] * 4 + [True] + [False] * 7), run([None] * 4 + [True] * 4 + [False] * 4)

    assert (lost.status, lost.failure) == ("failed", "tracking lost in 7 of 8 frames")
    assert lost.frame_us == [10_000] * 12
    assert lost.stages_us["tracking"] == [2499] * 12  # never more than the frame in all
    assert (held.status, held.failure) == ("ok", None)


def test_a_trajectory_that_is_not_finite_is_a_failure_without_times() -> None:
    unknown = [*REFERENCE[1:], [0.0, float("nan"), 0.0]]

    for failed in (
        run([True] * 12, float("nan")),
        run([True] * 12, positions=unknown),
    ):
        assert (failed.status, failed.failure) == ("failed", "the trajectory is not finite")
        assert (failed.frame_us, failed.deviation) == ([], None)


def test_stages_that_were_not_measured_are_left_out() -> None:
    assert run([True] * 12, stage=None).stages_us == {}


def test_a_run_is_as_far_from_its_reference_as_in_its_worst_frame() -> None:
    positions = [[0.0, 0.001, 0.0]] * 11 + [[0.0, 0.003, 0.004]]

    far = run([True] * 12, positions=positions)
    near = run([True] * 12, positions=[[0.0, 0.0, 0.003]] * 12)

    assert far.deviation == pytest.approx(0.005)
    assert (far.deviates(ASKED), near.deviates(ASKED)) == (True, False)


def test_a_run_that_failed_has_no_deviation() -> None:
    lost = run([True] + [False] * 11)

    assert (lost.status, lost.deviation, lost.deviates(ASKED)) == ("failed", None, False)
    assert recorded("best", 0, 0, "out of memory", REFERENCE).deviation is None
