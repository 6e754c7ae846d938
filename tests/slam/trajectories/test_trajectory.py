import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slam.trajectories.trajectory import (
    Trajectory,
    TrajectoryError,
    absolute_trajectory_error,
    associate,
    quaternion_from_rotation,
    relative_pose_error,
    rotation_from_quaternion,
    umeyama,
)
from tests.slam.real import DATA, needs_real_data
from tests.slam.sequences import random_poses, random_rotation

seeds = st.integers(0, 2**32 - 1)


def rigid(rng, distance=3.0):
    transform = np.eye(4)
    transform[:3, :3] = random_rotation(rng)
    transform[:3, 3] = rng.normal(0, distance, 3)
    return transform


@given(seeds)
def test_quaternions_and_rotations_are_inverse(seed):
    rng = np.random.default_rng(seed)
    rotations = np.array([random_rotation(rng) for _ in range(5)])
    quaternions = quaternion_from_rotation(rotations)
    assert (quaternions[:, 3] >= 0).all()
    np.testing.assert_allclose(rotation_from_quaternion(quaternions), rotations, atol=1e-12)


@pytest.mark.parametrize("axis", range(3))
def test_half_turns_have_a_quaternion(axis):
    R = -np.eye(3)
    R[axis, axis] = 1
    expected = np.zeros(4)
    expected[axis] = 1
    np.testing.assert_allclose(np.abs(quaternion_from_rotation(R[None])[0]), expected, atol=1e-12)


@given(seeds)
def test_a_rigid_motion_of_the_estimate_changes_no_error(seed):
    rng = np.random.default_rng(seed)
    truth = random_poses(20, rng)
    estimate = truth.copy()
    estimate[:, :3, 3] += rng.normal(0, 0.01, (20, 3))
    moved = rigid(rng) @ estimate
    for alignment in ("first", "se3", "sim3"):
        before = absolute_trajectory_error(estimate, truth, alignment)
        after = absolute_trajectory_error(moved, truth, alignment)
        np.testing.assert_allclose(after.per_frame, before.per_frame, atol=1e-9)


@given(seeds, st.floats(0.1, 10))
def test_umeyama_finds_the_similarity_that_was_applied(seed, scale):
    rng = np.random.default_rng(seed)
    source = rng.normal(size=(10, 3))
    transform = rigid(rng)
    target = scale * source @ transform[:3, :3].T + transform[:3, 3]
    R, t, s = umeyama(source, target, with_scale=True)
    np.testing.assert_allclose(R, transform[:3, :3], atol=1e-9)
    np.testing.assert_allclose(t, transform[:3, 3], atol=1e-8)
    assert s == pytest.approx(scale)


def test_first_pose_alignment_measures_distances_from_the_start():
    truth = np.tile(np.eye(4), (4, 1, 1))
    truth[:, 2, 3] = [0, 1, 2, 3]
    estimate = truth.copy()
    estimate[:, 0, 3] = [5, 5, 5, 5.3]
    error = absolute_trajectory_error(estimate, truth)
    np.testing.assert_allclose(error.per_frame, [0, 0, 0, 0.3], atol=1e-12)
    assert error.max == pytest.approx(0.3)
    assert error.mean == pytest.approx(0.075)
    assert error.rmse == pytest.approx(0.15)
    assert error.rmse_aligned < error.rmse


def test_frames_without_truth_are_left_out_and_alignment_starts_at_the_first_known_one():
    truth = np.tile(np.eye(4), (3, 1, 1))
    truth[0] = np.nan
    estimate = np.tile(np.eye(4), (3, 1, 1))
    estimate[0, 0, 3] = 9
    estimate[2, 0, 3] = 0.1
    error = absolute_trajectory_error(estimate, truth)
    np.testing.assert_allclose(error.per_frame, [np.nan, 0, 0.1])
    assert error.mean == pytest.approx(0.05)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda e, t: (e[:-1], t), "must both be"),
        (lambda e, t: (np.where(np.arange(4)[:, None, None] == 2, np.nan, e), t), "frame 2 is not finite"),
        (lambda e, t: (e, np.full_like(t, np.nan)), "none of the 4 frames has a true pose"),
    ],
)
def test_trajectories_that_cannot_be_compared_are_refused(change, message):
    poses = np.tile(np.eye(4), (4, 1, 1))
    with pytest.raises(TrajectoryError, match=message):
        absolute_trajectory_error(*change(poses, poses.copy()))


def test_a_still_estimate_has_no_scale():
    still = np.tile(np.eye(4), (4, 1, 1))
    with pytest.raises(TrajectoryError, match="never moves"):
        absolute_trajectory_error(still, random_poses(4, np.random.default_rng(0)), "sim3")


def test_relative_pose_error_sees_a_constant_drift_per_frame():
    truth = np.tile(np.eye(4), (10, 1, 1))
    estimate = truth.copy()
    estimate[:, 0, 3] = np.arange(10) * 0.01
    assert relative_pose_error(estimate, truth).translation == pytest.approx(0.01)
    assert relative_pose_error(estimate, truth, delta=3).translation == pytest.approx(0.03)
    assert relative_pose_error(estimate, truth).rotation == 0


def test_association_takes_the_closest_stamp_and_each_only_once():
    first, second = associate(np.array([0.0, 0.005, 1.0]), np.array([0.004, 0.5, 1.009, 0.001]))
    assert list(zip(first, second, strict=True)) == [(0, 3), (1, 0), (2, 2)]


@given(seeds)
def test_a_written_trajectory_reads_back(tmp_path_factory, seed):
    rng = np.random.default_rng(seed)
    trajectory = Trajectory(np.arange(7) / 30, random_poses(7, rng, step=1.0))
    path = tmp_path_factory.mktemp("trajectory") / "poses.txt"
    trajectory.write(path)
    again = Trajectory.read(path)
    np.testing.assert_allclose(again.poses, trajectory.poses, atol=5e-9)
    np.testing.assert_allclose(again.timestamps, trajectory.timestamps, atol=5e-7)


def test_poses_that_are_not_known_are_not_written(tmp_path):
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[1] = np.nan
    Trajectory(np.arange(3.0), poses).write(tmp_path / "poses.txt")
    assert Trajectory.read(tmp_path / "poses.txt").timestamps.tolist() == [0.0, 2.0]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "holds no pose"),
        ("# only a comment\n", "holds no pose"),
        ("0 1 2 3 0 0 0 1\n1 2 3\n", "line 2: '1 2 3' is not a pose"),
        ("0 1 2 nan 0 0 0 1\n", "line 1"),
        ("0 1 2 3 0 0 0 0\n", "is not a rotation"),
        ("0 1 2 1e308 0 0 0 1\n", r"line 1: .* is out of range: write seconds up to 1e\+12 and metres"),
        ("0 1 2 3 a 0 0 1\n", "line 1"),
    ],
)
def test_a_file_that_is_no_trajectory_says_where(tmp_path, text, message):
    path = tmp_path / "bad.txt"
    path.write_text(text)
    with pytest.raises(TrajectoryError, match=message):
        Trajectory.read(path)


@pytest.mark.slow
@needs_real_data
@pytest.mark.parametrize(
    ("estimate", "truth", "alignment", "rmse"),
    [
        ("freiburg1_xyz-rgbdslam.txt", "freiburg1_xyz-groundtruth.txt", "se3", 0.013470),
        ("fr2_desk_ORB.txt", "fr2_desk_groundtruth.txt", "sim3", 0.006123),
    ],
)
def test_real_estimates_have_the_error_that_evo_finds(estimate, truth, alignment, rmse):
    estimated = Trajectory.read(DATA / "trajectories/tum" / estimate)
    true = Trajectory.read(DATA / "trajectories/tum" / truth)
    i, j = associate(estimated.timestamps, true.timestamps)
    error = absolute_trajectory_error(estimated.poses[i], true.poses[j], alignment)
    assert error.rmse == pytest.approx(rmse, abs=5e-7)


@needs_real_data
def test_real_drift_has_the_relative_error_that_evo_finds():
    folder = DATA / "trajectories/tum"
    estimated = Trajectory.read(folder / "freiburg1_xyz-rgbdslam.txt")
    true = Trajectory.read(folder / "freiburg1_xyz-groundtruth.txt")
    i, j = associate(estimated.timestamps, true.timestamps)
    error = relative_pose_error(estimated.poses[i], true.poses[j])
    assert error.translation == pytest.approx(0.0057643708, abs=1e-9)
    assert error.rotation == pytest.approx(0.3536131610, abs=1e-9)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (np.zeros((4, 4)), "pose of frame 2 is not a pose: its 3x3 part is not a rotation"),
        (np.diag([1.0, 1.0, -1.0, 1.0]), "not a rotation"),  # a reflection
        (np.diag([1.002, 1.0, 1.0, 1.0]), "not a rotation"),
        (np.eye(4) + 1e308 * np.eye(4, k=3), "its position 1e.308 0 0 is not within"),
        (np.eye(4) + np.eye(4, k=-3), "its last row is not 0 0 0 1"),
    ],
)
def test_a_true_pose_that_is_not_a_rigid_motion_is_named(change, message):
    poses = np.tile(np.eye(4), (4, 1, 1))
    truth = poses.copy()
    truth[0] = np.nan  # not known, which is allowed
    truth[2] = change
    with pytest.raises(TrajectoryError, match=message):
        absolute_trajectory_error(poses, truth)


def test_rotations_written_with_four_digits_are_rotations():
    rng = np.random.default_rng(3)
    truth = np.round(random_poses(20, rng), 4)
    assert absolute_trajectory_error(truth, truth).max == pytest.approx(0, abs=1e-3)
