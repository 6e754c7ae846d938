"""A configuration that adapts skips frames while the camera moves little, and fuses by motion."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from slam.devices.choice import choose_device, open_session
from slam.kfusion.configuration import CAUTIOUS_FRAMES, Configuration
from slam.kfusion.pipeline import KFusion
from slam.system import Frame
from tests.slam.kfusion.test_pipeline import SCENE, depth_from
from tests.slam.numpy_kernels.adapting import moved
from tests.slam.numpy_kernels.dense import exponential
from tests.slam.numpy_kernels.kfusion import rotation_between

ADAPTIVE = Configuration(
    compute_size_ratio=2, volume_resolution=64, mu=0.2, integration_rate=1, skip_limit=2,
    skip_translation=0.03, skip_rotation=0.02, integrate_translation=0.03, integrate_rotation=0.03,
)  # fmt: skip
STEP = np.array([0.003, -0.001, 0.002, 0.0005, 0.001, 0])  # m and rad
FRAMES = 22
DARK = np.zeros((SCENE.camera.height, SCENE.camera.width), np.uint16)


def path(speed: float, frames: int = FRAMES, jump: int = FRAMES) -> np.ndarray:
    """Poses at rest for four frames, then STEP a frame times `speed`. From frame `jump` on the camera stands
    6 cm beside."""
    steps = speed * np.maximum(np.arange(frames) - 3, 0)
    poses = np.array([exponential(STEP * step) for step in steps])
    poses[jump:, 0, 3] += 0.06
    return poses


def images(poses: np.ndarray) -> list[np.ndarray]:
    return [depth_from(pose) for pose in poses]


SLOW = path(1)
SLOW_IMAGES = images(SLOW)


def run(session, depth: list[np.ndarray], configuration: Configuration = ADAPTIVE) -> list[Frame]:
    system = KFusion(configuration, SCENE, session)
    return [system.process(image) for image in depth]


def skipped(frames: list[Frame]) -> list[int]:
    return [number for number, frame in enumerate(frames) if frame.skipped]


def positions(frames: list[Frame]) -> np.ndarray:
    return np.array([frame.pose[:3, 3] for frame in frames])


def expected_skips(limit: int) -> list[int]:
    """One after the second that is tracked, since the camera just began to move; then `limit` in turn."""
    return [6, *(number for number in range(8, FRAMES) if (number - 7) % (limit + 1))]


@pytest.fixture(scope="module")
def reference() -> list[Frame]:
    return run(open_session(choose_device()), SLOW_IMAGES)


def test_every_backend_skips_the_same_frames_of_a_slow_camera(session, reference):
    frames = run(session, SLOW_IMAGES)

    assert skipped(frames) == skipped(reference) == expected_skips(2)
    assert [frame.integrated for frame in frames] == [frame.integrated for frame in reference]
    assert np.linalg.norm(positions(frames) - positions(reference), axis=1).max() < 0.001
    away = positions(frames) - positions(frames)[0] - SLOW[:, :3, 3]
    assert np.linalg.norm(away, axis=1).max() < 0.01


def test_a_skipped_frame_has_the_expected_pose_and_nothing_else(reference):
    tracked = {number: frame.pose for number, frame in enumerate(reference) if not frame.skipped}
    for number in skipped(reference)[3:]:
        last = max(other for other in tracked if other < number)
        pose, before = tracked[last], tracked[last - 3]
        share = (number - last) / 3
        velocity, turn = (pose - before)[:3, 3], rotation_between(before, pose)
        frame = reference[number]
        np.testing.assert_allclose(frame.pose, moved(pose, share * velocity, share * turn), atol=1e-5)
        assert (frame.tracked, frame.integrated, frame.refusal, frame.degenerate) == (None, False, None, None)
        assert set(frame.seconds.values()) <= {0.0}
    assert all(reference[number].tracked for number in tracked if number >= 4)


@pytest.mark.parametrize(
    ("speed", "changed", "frames"),
    [
        (11, {}, []),
        (1, {"skip_limit": 1}, expected_skips(1)),
        (1, {"skip_limit": 0}, []),
        (1, {"skip_rotation": 0.0005}, []),
        (1, {"integrate_translation": 0, "integrate_rotation": 0}, expected_skips(2)),
    ],
    ids=str,
)
def test_the_motion_and_the_limit_decide_which_frames_are_skipped(cpu, speed, changed, frames):
    found = run(cpu, images(path(speed)), dataclasses.replace(ADAPTIVE, **changed))

    assert skipped(found) == frames
    assert all(frame.tracked for frame in found[4:] if not frame.skipped)


def test_frames_are_fused_by_motion(cpu):
    """At first, and then where the camera is 3 cm from where one was fused: after 8 frames of 3.7 mm."""
    frames = run(cpu, SLOW_IMAGES, dataclasses.replace(ADAPTIVE, skip_limit=0))

    assert [number for number, frame in enumerate(frames) if frame.integrated] == [*range(9), 16]


def test_a_refused_frame_returns_to_the_last_tracked_pose(cpu):
    """And none is skipped until ten were tracked again."""
    lost = 10  # after two skipped ones
    frames = run(cpu, [*SLOW_IMAGES[:lost], DARK, *SLOW_IMAGES[lost + 1 :]])

    assert skipped(frames[: lost + 1]) == [6, 8, 9]
    assert frames[lost].tracked is False
    np.testing.assert_array_equal(frames[lost].pose, frames[7].pose)
    assert [frame.tracked for frame in frames[lost + 1 : lost + 11]] == [True] * 10
    assert skipped(frames[lost + 1 :])[0] == 10
    assert all(frame.integrated for frame in frames[lost + 1 : lost + 11])


def test_after_a_pose_that_was_not_expected_none_is_skipped_for_a_while(cpu):
    jump = 10  # a tracked frame, after two skipped ones
    frames = run(cpu, images(path(1, jump=jump)))

    assert skipped(frames[: jump + 1]) == [6, 8, 9]
    assert [frame.tracked for frame in frames[jump : jump + CAUTIOUS_FRAMES + 1]] == [True] * 9
    assert frames[jump + CAUTIOUS_FRAMES + 1].skipped


def test_nothing_is_skipped_before_the_first_image_with_depth(cpu):
    frames = run(cpu, [DARK] * 3 + SLOW_IMAGES)

    assert skipped(frames) == [3 + number for number in expected_skips(2)]
