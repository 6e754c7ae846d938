"""A refusal is not the end: the next frames find the camera again. Frames that track pay nothing for it."""

from __future__ import annotations

import numpy as np
import pytest

from slam.devices.layout import KINDS, Layout
from slam.kfusion.configuration import Configuration
from slam.kfusion.pipeline import KFusion
from slam.kfusion.plan import plan
from slam.kfusion.refusals import Refusal
from tests.slam.kfusion.test_pipeline import SCENE, depth_from
from tests.slam.numpy_kernels.dense import exponential

QUICK = Configuration(
    compute_size_ratio=2, volume_resolution=64, mu=0.2, integration_rate=5, pyramid_iterations_fine=3,
    pyramid_iterations_middle=2, pyramid_iterations_coarse=2,
)  # fmt: skip
FIRST = 4  # the first frame that is tracked


def swing(rate: float, frames: int) -> list[np.ndarray]:
    """Poses of a camera that rests for four frames, then looks to and fro, up to `rate` radians a frame."""
    turns = rate / 0.35 * np.sin(0.35 * np.maximum(np.arange(frames) - 3, 0))
    return [exponential(np.array([0, 0, 0, 0, turn, 0])) for turn in turns]


@pytest.mark.slow
def test_a_camera_that_turns_too_fast_is_found_again_in_the_next_frame(session):
    """Before, each refusal made the next one more likely: 33 of these 36 frames were lost."""
    poses = swing(0.22, 40)
    system = KFusion(QUICK, SCENE, session)
    frames = [system.process(depth_from(pose)) for pose in poses]

    lost = [number for number, frame in enumerate(frames) if frame.tracked is False]
    assert 0 < len(lost) <= 6
    assert all(frames[number + 1].tracked for number in lost)
    for frame, pose in zip(frames, poses, strict=True):
        if frame.tracked:
            assert np.linalg.norm(frame.pose[:3, 3] - frames[0].pose[:3, 3] - pose[:3, 3]) < 0.05


@pytest.mark.parametrize("kind", KINDS)
def test_a_frame_that_tracks_launches_nothing_for_those_that_do_not(kind):
    made = plan(QUICK, SCENE, Layout(kind))
    before = made.initial_state()

    def launched() -> list[str]:
        return [d.kernel for d in made.dispatches if d.takes_place(FIRST, before) and d.stage == "tracking"]

    levels = ["track", "solve"] * sum(QUICK.iterations) if kind == "pixels" else ["iterate"] * 3
    attempt = [*levels, "check_pose"]
    tracking = ["half_sample"] * 2 + ["normal_map"] * 3 + ["begin_tracking", *attempt]
    assert launched() == tracking
    before["recovering"] = 10
    assert launched() == tracking
    before["refusal"] = Refusal.FAR_MOTION
    assert launched()[: len(tracking) + 1] == [*tracking, "begin_retry"]
    assert launched()[-1] == "check_pose"


def test_a_camera_that_recovers_is_integrated_in_every_frame():
    made = plan(QUICK, SCENE, Layout("rows"))
    state = made.initial_state()

    def integrated() -> list[int]:
        dispatches = [d for d in made.dispatches if d.kernel == "integrate"]
        return [n for n in range(4, 12) for d in dispatches if d.takes_place(n, state)]

    assert integrated() == [5, 10]
    state["recovering"] = 3
    assert integrated() == list(range(4, 12))


def test_a_lost_frame_says_which_rule_refused_it(cpu):
    dark = np.zeros((SCENE.camera.height, SCENE.camera.width), np.uint16)
    view, beyond = depth_from(np.eye(4)), depth_from(exponential(np.array([0, 0, 0, 0, 1.2, 0])))
    system = KFusion(QUICK, SCENE, cpu)
    frames = [system.process(image) for image in [view] * 5 + [dark, view, beyond, view]]

    assert [frame.tracked for frame in frames] == [None] * 4 + [True, False, True, False, True]
    assert frames[5].refusal == "too few inliers: 0% of the pixels, 15% are needed"
    assert frames[7].refusal is not None
    assert all(frame.refusal is None for frame in frames if frame.tracked is not False)
