"""What the worker keeps of a run, and when it believes the device's clock."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.client_kit.web.serving import evaluated

QUANTUM = 65536e-9  # seconds: so coarse are the timestamps of browsers
PLANNED = {"configuration": "best", "repeat": 1, "order": 2}
RECORD = """async ({ frames, truth, trajectory, timed }) => {
    const { finishedRun, isPlausible } = await import("/measure/run-record.js");
    const frame = { first: 4, last: null, every: 1, after: null };
    const plan = { dispatches: [{ kernel: "check_pose", frames: [frame] }] };
    const outcomes = frames.map(({ pose, tracked, farthest, ...outcome }) => (
        { state: { pose: Float32Array.from(pose), tracked, farthest: farthest ?? 2 }, ...outcome }
    ));
    const planned = { configuration: "best", repeat: 1, order: 2 };
    return [finishedRun(planned, plan, outcomes, { truth, trajectory }, timed), isPlausible(outcomes)];
}"""


def frames_of(stages: list[list[float]], tracked: int = 1) -> list[dict[str, Any]]:
    """Frames of 10 ms each along x, with the seconds of two stages each."""
    return [
        {
            "pose": [1, 0, 0, 0.1 * number, 0, 1, 0, 0, 0, 0, 1, 0],
            "tracked": tracked,
            "seconds": 0.01,
            "stages": {"tracking": first, "raycasting": second},
        }
        for number, (first, second) in enumerate(stages)
    ]


def recorded(page: Any, frames: list[dict[str, Any]], timed: bool = True) -> tuple[dict[str, Any], bool]:
    poses = [np.array(frame["pose"]) for frame in frames]
    order = {
        "frames": frames,
        "truth": [None, *(pose.tolist() for pose in poses[1:])],
        "trajectory": [pose[3::4].tolist() for pose in poses],
        "timed": timed,
    }
    run, plausible = evaluated(page, RECORD, order)
    return run, plausible


def test_a_finished_run_is_what_protocol_2_sends(web_page: Any) -> None:
    run, plausible = recorded(web_page, frames_of([[0.006, 0.003]] * 6))

    assert plausible
    assert run | {"id": "", "deviation": 0} == PLANNED | {
        "id": "", "status": "ok", "failure": None, "frame_us": [10000] * 6,
        "stages_us": {"tracking": [6000] * 6, "raycasting": [3000] * 6},
        "tracked": [None, None, None, None, True, True], "deviation": 0,
        "ate_max": pytest.approx(0, abs=1e-7), "ate_mean": pytest.approx(0, abs=1e-7),
        "ate_rmse": pytest.approx(0, abs=1e-7),
    }  # fmt: skip
    assert run["deviation"] == pytest.approx(0, abs=1e-7)


def test_without_a_clock_a_run_has_no_stages(web_page: Any) -> None:
    run, _ = recorded(web_page, frames_of([[0.006, 0.003]] * 6), timed=False)

    assert "stages_us" not in run


def test_coarse_timestamps_are_believed_and_never_add_up_to_more_than_the_frame(web_page: Any) -> None:
    random = np.random.default_rng(4)
    times = np.sort(random.uniform(0, 0.01, (200, 3)), axis=1)
    times[:, 0], times[:, 2] = 0, 0.00999
    times += random.uniform(0, QUANTUM, (200, 1))
    stages = np.diff(np.round(times / QUANTUM) * QUANTUM, axis=1)

    run, plausible = recorded(web_page, frames_of(stages.tolist()))

    assert plausible
    sums = np.sum(list(run["stages_us"].values()), axis=0)
    assert (stages.sum(axis=1) > 0.01).any()
    assert (sums <= 10000).all()
    assert (sums >= 9900).all()


@pytest.mark.parametrize(
    "stages",
    [
        [[0.006, -0.001]] * 20,
        [[0.0, 0.0]] * 20,
        [[0.006, 0.005]] * 20,
        [[0.006, 0.003]] * 18 + [[6.0, 0.0]] * 2,
    ],
    ids=["negative", "standing still", "too long", "too long now and then"],
)
def test_a_clock_that_cannot_be_right_is_not_believed(web_page: Any, stages: list[list[float]]) -> None:
    run, plausible = recorded(web_page, frames_of(stages))

    assert not plausible
    assert all(min(series) >= 0 for series in run["stages_us"].values())
    assert (np.sum(list(run["stages_us"].values()), axis=0) <= 10000).all()


def test_frames_are_counted_from_the_first_that_measured_anything(web_page: Any) -> None:
    frames = frames_of([[0.006, 0.003]] * 8)
    dark = [frame | {"farthest": 0} for frame in frames]

    late, _ = recorded(web_page, [*dark[:2], *frames[2:]])
    never, _ = recorded(web_page, dark)

    assert late["tracked"] == [None] * 6 + [True] * 2
    assert never["tracked"] == [None] * 8
    assert (never["status"], never["failure"]) == ("failed", "no frame was tracked")


def test_a_skipped_frame_was_not_tracked_and_keeps_its_time(web_page: Any) -> None:
    frames = frames_of([[0.006, 0.003]] * 8)
    nothing = {"skipped": True, "seconds": 0.000002, "stages": {"tracking": 0, "raycasting": 0}}

    run, plausible = recorded(web_page, [*frames[:5], frames[5] | nothing, *frames[6:]])

    assert plausible
    assert run["tracked"] == [None] * 4 + [True, None, True, True]
    assert run["frame_us"][4:7] == [10000, 2, 10000]
    assert run["stages_us"]["tracking"][4:7] == [6000, 0, 6000]


def test_a_run_that_lost_the_camera_in_most_frames_has_failed(web_page: Any) -> None:
    frames = frames_of([[0.006, 0.003]] * 9)
    lost = frames_of([[0.006, 0.003]] * 9, tracked=0)

    half, _ = recorded(web_page, [*lost[:6], *frames[6:]])
    most, _ = recorded(web_page, [*lost[:7], *frames[7:]])

    assert (half["status"], half["tracked"].count(False)) == ("ok", 2)
    assert (most["status"], most["failure"]) == ("failed", "tracking lost in 3 of 5 frames")
    assert len(most["frame_us"]) == 9
    assert "deviation" not in most


def test_a_run_whose_trajectory_is_not_finite_has_failed(web_page: Any) -> None:
    frames = frames_of([[0.006, 0.003]] * 6)
    script = RECORD.replace("Float32Array.from(pose)", "Float32Array.from(pose).fill(NaN)")

    run, _ = evaluated(
        web_page,
        script,
        {"frames": frames, "truth": [None] * 6, "trajectory": [[0, 0, 0]] * 6, "timed": True},
    )

    assert (run["status"], run["failure"]) == ("failed", "the trajectory is not finite")
    assert (run["frame_us"], run["stages_us"], run["tracked"], run["ate_max"]) == ([], {}, [], None)
