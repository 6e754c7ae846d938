"""KinectFusion over a small synthetic room: what it computes on every device, what it decides on one."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from slam.camera import Camera
from slam.configuration import ConfigurationError
from slam.devices.choice import AnySession, open_session
from slam.devices.device import DeviceMemoryError
from slam.kfusion.configuration import Configuration
from slam.kfusion.pipeline import KFusion
from slam.system import Frame, Scene
from tests.slam.numpy_kernels.dense import exponential

CAMERA = Camera(120.0, 120.0, 79.5, 59.5, 160, 120)
SCENE = Scene(CAMERA, volume_size=3.2, initial_position=(0.5, 0.5, 0.1))
SMALL = Configuration(volume_resolution=128, integration_rate=1, mu=0.1)
FRAMES = 14


def depth_from(pose: np.ndarray) -> np.ndarray:
    """Depth in millimetres of a box-shaped room with three balls in it, from a camera at `pose`."""
    y, x = np.mgrid[: CAMERA.height, : CAMERA.width]
    rays = np.dstack([(x - CAMERA.cx) / CAMERA.fx, (y - CAMERA.cy) / CAMERA.fy, np.ones(x.shape)])
    directions, origin = rays @ pose[:3, :3].T, pose[:3, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        walls = np.maximum((np.array([-1.2, -1.0, -0.3]) - origin) / directions,
                           (np.array([1.2, 1.0, 2.2]) - origin) / directions)  # fmt: skip
    nearest = np.nanmin(walls, axis=-1)
    for centre, radius in (((-0.5, 0.4, 1.5), 0.4), ((0.5, 0.2, 1.8), 0.35), ((0.1, -0.5, 1.3), 0.3)):
        offset = origin - centre
        a, b = np.sum(directions**2, axis=-1), directions @ offset
        discriminant = b**2 - a * (offset @ offset - radius**2)
        hit = (-b - np.sqrt(np.maximum(discriminant, 0))) / a
        nearest = np.where((discriminant > 0) & (hit > 0), np.minimum(nearest, hit), nearest)
    return np.rint(nearest * 1000).astype(np.uint16)


def handheld(frames: int = FRAMES) -> np.ndarray:
    """At rest for the four frames that are never tracked, then about 9 mm and 0.3 degrees a frame."""
    steps = np.maximum(np.arange(frames) - 3, 0)
    return np.array([exponential(np.array([0.007, -0.003, 0.005, 0.002, 0.005, -0.001]) * n) for n in steps])


TRUTH = handheld()
DEPTH = [depth_from(pose) for pose in TRUTH]


def run(session: AnySession, configuration: Configuration, depth: list[np.ndarray] = DEPTH):
    system = KFusion(configuration, SCENE, session)
    return [system.process(image) for image in depth]


@pytest.fixture(scope="module")
def followed(session: AnySession) -> list[Frame]:
    """The frames of the small configuration, of each place."""
    return run(session, SMALL)


@pytest.fixture(scope="module")
def followed_here(cpu: AnySession) -> list[Frame]:
    """The same of one device."""
    return run(cpu, SMALL)


def errors(frames) -> np.ndarray:
    positions = np.array([frame.pose[:3, 3] for frame in frames])
    return np.linalg.norm(positions - positions[0] - TRUTH[: len(frames), :3, 3], axis=1)


def test_rays_that_are_cast_after_fusion_follow_the_camera_and_show_what_was_seen_last(session):
    system = KFusion(dataclasses.replace(SMALL, integration_rate=5, raycast_after_fusion=1), SCENE, session)
    frames = [system.process(image) for image in DEPTH]

    assert errors(frames).max() < 0.003
    assert all(frame.tracked for frame in frames[4:])
    assert [number for number in range(4, FRAMES) if frames[number].integrated] == [5, 10]
    np.testing.assert_allclose(system.view().eye, frames[10].pose[:3, 3])


def test_it_follows_the_camera_within_two_millimetres(followed):
    assert errors(followed).max() < 0.002
    assert [frame.tracked for frame in followed] == [None] * 4 + [True] * (FRAMES - 4)
    assert all(frame.integrated for frame in followed)


@pytest.mark.slow
def test_two_runs_give_the_same_bits(session, followed):
    np.testing.assert_array_equal([f.pose for f in run(session, SMALL)], [f.pose for f in followed])


def test_depth_is_sampled_by_the_compute_size_ratio(cpu):
    assert errors(run(cpu, dataclasses.replace(SMALL, compute_size_ratio=2))).max() < 0.01


def test_rates_skip_tracking_and_integration(cpu):
    frames = run(cpu, dataclasses.replace(SMALL, tracking_rate=3, integration_rate=4))
    assert [f.tracked for f in frames] == [None] * 6 + [True, None, None] * 2 + [True, None]
    # Before the first check has passed nothing but the first four frames is fused.
    assert [n for n, f in enumerate(frames) if f.integrated] == [0, 1, 2, 3, 8, 12]
    np.testing.assert_array_equal(frames[7].pose, frames[6].pose)


def test_a_lost_frame_keeps_the_last_pose_and_is_not_fused(cpu):
    blind = np.zeros_like(DEPTH[0])
    frames = run(cpu, SMALL, [*DEPTH[:8], blind, *DEPTH[8:10]])
    assert frames[8].tracked is False
    assert not frames[8].integrated
    np.testing.assert_array_equal(frames[8].pose, frames[7].pose)
    assert frames[9].tracked is True


@pytest.mark.parametrize("iterations", [(0, 5, 4), (10, 0, 0), (0, 0, 6)], ids=str)
def test_a_level_may_have_no_iterations(cpu, iterations):
    fine, middle, coarse = iterations
    configuration = dataclasses.replace(
        SMALL,
        pyramid_iterations_fine=fine,
        pyramid_iterations_middle=middle,
        pyramid_iterations_coarse=coarse,
    )
    frames = run(cpu, configuration)
    assert all(frame.tracked for frame in frames[4:])
    assert errors(frames).max() < 0.03


def test_a_threshold_above_one_means_one_iteration_a_level(cpu):
    """So ten iterations under it end where one does, and zero never ends them early."""
    one = dataclasses.replace(
        SMALL, pyramid_iterations_fine=1, pyramid_iterations_middle=1, pyramid_iterations_coarse=1
    )
    stopped = dataclasses.replace(SMALL, icp_threshold=32.8)
    endless = dataclasses.replace(SMALL, icp_threshold=0.0)
    np.testing.assert_array_equal(run(cpu, one)[-1].pose, run(cpu, stopped)[-1].pose)
    assert not np.array_equal(run(cpu, endless)[-1].pose, run(cpu, stopped)[-1].pose)


BLIND = np.zeros_like(DEPTH[0])


def test_no_depth_at_all_is_not_attempted_and_not_an_error(cpu):
    frames = run(cpu, SMALL, [BLIND] * 6)
    assert [frame.tracked for frame in frames] == [None] * 6
    assert not any(frame.integrated for frame in frames)


def test_it_starts_with_the_first_frame_that_has_depth(cpu, followed_here):
    dark = 6
    frames = run(cpu, SMALL, [BLIND] * dark + DEPTH)
    assert [frame.tracked for frame in frames] == [None] * (dark + 4) + [True] * (FRAMES - 4)
    assert [frame.integrated for frame in frames] == [False] * dark + [True] * FRAMES
    poses = [frame.pose for frame in frames]
    np.testing.assert_array_equal(poses[: dark + 1], [poses[0]] * (dark + 1))
    # As if the dark frames had never been.
    np.testing.assert_array_equal(poses[dark:], [frame.pose for frame in followed_here])


@pytest.mark.slow
def test_extreme_depth_does_no_harm(session):
    random = np.random.default_rng(0)
    noise = [random.integers(0, 65536, DEPTH[0].shape, dtype=np.uint16) for _ in range(6)]
    frames = run(session, SMALL, noise)
    assert np.isfinite([frame.pose for frame in frames]).all()


def test_a_volume_that_does_not_fit_names_what_would(session):
    device = dataclasses.replace(session.device, max_allocation=100 * 2**20)
    small_device = open_session(device, session.layout)
    with pytest.raises(
        DeviceMemoryError, match=r"volume_resolution=512 needs one buffer of 512 MiB.*choose 256 or less"
    ):
        KFusion(dataclasses.replace(SMALL, volume_resolution=512), SCENE, small_device)


def test_a_ratio_that_does_not_divide_the_image_is_refused(cpu):
    with pytest.raises(ConfigurationError, match="compute_size_ratio=7"):
        KFusion(dataclasses.replace(SMALL, compute_size_ratio=7), SCENE, cpu)


def test_a_depth_image_of_another_size_is_refused(cpu):
    system = KFusion(SMALL, SCENE, cpu)
    with pytest.raises(ValueError, match=r"uint16 \(120, 160\)"):
        system.process(np.zeros((60, 80), np.uint16))


def test_one_launch_for_all_iterations_gives_the_poses_of_one_for_each(cpu, followed_here, monkeypatch):
    monkeypatch.setattr("slam.kfusion.plan.SMALL_IMAGE", 0)
    apart = run(cpu, SMALL)

    assert all(frame.tracked for frame in followed_here[4:])
    for one, other in zip(followed_here, apart, strict=True):
        np.testing.assert_allclose(one.pose, other.pose, atol=1e-5)
