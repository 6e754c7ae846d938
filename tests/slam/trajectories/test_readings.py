import json

import numpy as np
import pytest

from slam.__main__ import main
from slam.trajectories.readings import mirror_y, reading_warnings, w_first
from slam.trajectories.trajectory import Trajectory, quaternion_from_rotation, rotation_from_quaternion
from tests.slam.real import DATA, needs_real_data

SECONDS = np.arange(90) / 30


def handheld(noise=0.0):
    """Poses of a camera that sways by 20 degrees and 30 cm, about 1 degree and 5 mm off with a `noise` of
    1."""
    rng = np.random.default_rng(3)
    t = SECONDS[:, None]
    angles = 0.35 * np.sin(t * [1.1, 1.7, 2.3]) + noise * rng.normal(0, 0.01, (90, 3))
    poses = np.tile(np.eye(4), (90, 1, 1))
    half = np.linalg.norm(angles, axis=1, keepdims=True) / 2
    quaternions = np.hstack([angles / 2 * np.sinc(half / np.pi), np.cos(half)])
    poses[:, :3, :3] = rotation_from_quaternion(quaternions)
    poses[:, :3, 3] = 0.3 * np.sin(t * [1.3, 0.9, 0.7]) + noise * rng.normal(0, 0.005, (90, 3))
    return poses


def test_noise_a_camera_that_was_lost_and_one_that_stood_still_are_not_doubted():
    truth = handheld()
    lost = truth.copy()
    lost[30:] = lost[30]
    for estimate in (handheld(noise=1), lost, np.tile(np.eye(4), (90, 1, 1))):
        assert reading_warnings(estimate, truth, "opencv") == []
        assert reading_warnings(truth, estimate, "opencv") == []


@pytest.mark.parametrize("which", ["the estimate", "the truth"])
def test_a_quaternion_that_is_written_w_first_is_named(which):
    poses = [handheld(noise=1), handheld()]
    wrong = poses[which == "the truth"]
    quaternions = quaternion_from_rotation(wrong[:, :3, :3])
    wrong[:, :3, :3] = rotation_from_quaternion(quaternions[:, [3, 0, 1, 2]])
    warning = next(text for text in reading_warnings(*poses, "opencv") if "w first" in text)
    assert f"the quaternions of {which} are written w first: write qx qy qz qw" in warning


def test_w_first_undoes_the_other_order():
    poses = handheld()
    wrong = poses.copy()
    wrong[:, :3, :3] = rotation_from_quaternion(quaternion_from_rotation(poses[:, :3, :3])[:, [3, 0, 1, 2]])
    np.testing.assert_allclose(w_first(wrong), poses, atol=1e-12)


def test_evaluate_warns_of_a_truth_with_y_up_and_the_option_mirrors_it(tmp_path, capsys):
    Trajectory(SECONDS, handheld(noise=1)).write(tmp_path / "estimate.txt")
    Trajectory(SECONDS, mirror_y(handheld())).write(tmp_path / "truth.txt")
    command = [
        "evaluate",
        "--estimate",
        str(tmp_path / "estimate.txt"),
        "--truth",
        str(tmp_path / "truth.txt"),
    ]
    assert main(command) == 0
    captured = capsys.readouterr()
    assert "warning: positions differ by" in captured.err
    assert "give --truth-axes y-up" in captured.err
    assert len(json.loads(captured.out)["warnings"]) == 1
    assert main([*command, "--truth-axes", "y-up"]) == 0
    captured = capsys.readouterr()
    assert captured.err == ""
    assert json.loads(captured.out)["mean"] < 0.02


@needs_real_data
@pytest.mark.parametrize(
    ("estimate", "truth"),
    [
        ("freiburg1_xyz-rgbdslam.txt", "freiburg1_xyz-groundtruth.txt"),
        ("freiburg1_xyz-rgbdslam_drift.txt", "freiburg1_xyz-groundtruth.txt"),
        ("fr2_desk_ORB.txt", "fr2_desk_groundtruth.txt"),
    ],
)
def test_real_estimates_are_not_doubted(estimate, truth, capsys):
    folder = DATA / "trajectories" / "tum"
    assert main(["evaluate", "--estimate", str(folder / estimate), "--truth", str(folder / truth)]) == 0
    assert capsys.readouterr().err == ""
