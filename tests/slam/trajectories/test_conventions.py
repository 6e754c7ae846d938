import json
import math

import numpy as np
import pytest

from slam.__main__ import main
from slam.trajectories.conventions import CONVENTIONS, by_convention
from slam.trajectories.trajectory import (
    Trajectory,
    associate,
    quaternion_from_rotation,
    rotation_from_quaternion,
)
from tests.slam.real import DATA, needs_real_data

# evo 1.38.1 (PyPI) over `wandering()`: APE of the translation after align(), align(correct_scale=True) and
# align_origin(); RPE over one frame, all pairs, of the translation and of the angle in degrees.
EVO_APE = {
    "se3": {
        "rmse": 0.0290164398, "mean": 0.0257693350, "median": 0.0234267385,
        "std": 0.0133377342, "min": 0.0032996990, "max": 0.0754710939,
    },
    "sim3": {
        "rmse": 0.0174340724, "mean": 0.0156948579, "median": 0.0144794521,
        "std": 0.0075906729, "min": 0.0019471004, "max": 0.0512681637,
    },
    "first": {
        "rmse": 0.0900892022, "mean": 0.0735447855, "median": 0.0559090844,
        "std": 0.0520310376, "min": 0.0, "max": 0.1931413309,
    },
}  # fmt: skip
EVO_RPE = {
    "translation": {"rmse": 0.0189550462, "mean": 0.0183912876, "median": 0.0186836047, "max": 0.0267401586},
    "rotation_degrees": {
        "rmse": 0.4327785888, "mean": 0.4201730485, "median": 0.4289946035, "max": 0.5976831856,
    },
}  # fmt: skip


def wandering(count=150):
    """An estimate that drifts, scales and turns, and its truth: (count, 4, 4) each, from sines alone."""
    t = np.arange(count) / 30
    truth = np.tile(np.eye(4), (count, 1, 1))
    truth[:, :3, 3] = np.stack([np.sin(t), 0.3 * np.sin(2.1 * t), 0.5 * t], axis=1)
    truth[:, :3, :3] = _turned(np.stack([0.2 * np.sin(t), 0.5 * np.sin(0.7 * t), 0.1 * t], axis=1))
    estimate = np.tile(np.eye(4), (count, 1, 1))
    noise = np.stack([np.sin(37 * t), np.sin(53 * t), np.cos(71 * t)], axis=1)
    estimate[:, :3, 3] = 1.02 * truth[:, :3, 3] + 0.01 * noise + 0.004 * t[:, None] ** 2
    estimate[:, :3, :3] = truth[:, :3, :3] @ _turned(0.004 * noise)
    placed = np.eye(4)
    placed[:3, :3] = _turned(np.array([[0.4, -0.9, 0.3]]))[0]
    placed[:3, 3] = 1.5, -0.4, 2.0
    return placed @ estimate, truth


def _turned(vectors):
    halves = vectors / 2
    return rotation_from_quaternion(np.column_stack([halves, np.ones(len(vectors))]))


@pytest.mark.parametrize(("alignment", "recorded"), EVO_APE.items())
def test_absolute_errors_are_those_that_evo_recorded(tmp_path, capsys, alignment, recorded):
    for name, value in evaluated(tmp_path, capsys, alignment).items():
        if name in recorded:
            assert value == pytest.approx(recorded[name], abs=1e-8), name


def test_relative_errors_are_those_that_evo_recorded(tmp_path, capsys):
    rpe = evaluated(tmp_path, capsys, "se3")["rpe"]
    for part, recorded in EVO_RPE.items():
        for name, value in recorded.items():
            assert rpe[part][name] == pytest.approx(value, abs=1e-6), (part, name)


def evaluated(folder, capsys, alignment):
    """What `slam evaluate` prints of `wandering()`, through files."""
    for name, poses in zip(("estimate", "truth"), wandering(), strict=True):
        Trajectory(np.arange(len(poses)) / 30, poses).write(folder / name)
    files = ["--estimate", str(folder / "estimate"), "--truth", str(folder / "truth")]
    assert main(["evaluate", *files, "--align", alignment]) == 0
    return json.loads(capsys.readouterr().out)


def test_evaluate_names_each_convention(tmp_path, capsys):
    report = evaluated(tmp_path, capsys, "first")
    assert list(report["conventions"]) == ["slambench1", "slambench2", "slambench2_new", "tum"]
    assert report["matched_share"] == 1
    for name in ("mean", "max"):
        assert report["conventions"]["slambench2"]["ate"][name] == pytest.approx(report[name])
    assert report["conventions"]["tum"]["ate"]["rmse"] == pytest.approx(EVO_APE["se3"]["rmse"], abs=1e-8)
    assert report["conventions"]["tum"]["rpe"]["rmse"] == pytest.approx(
        EVO_RPE["translation"]["rmse"], abs=1e-8
    )


def reference_slambench1(estimate, truth):
    """checkPos.py in a few lines: frame by frame, the shift of the first position only."""
    first = truth[0][:3, 3] - estimate[0][:3, 3]
    errors = [math.dist(e[:3, 3] + first, t[:3, 3]) for e, t in zip(estimate, truth, strict=True)]
    return {"min": min(errors), "max": max(errors), "mean": sum(errors) / len(errors)}


def reference_slambench2(estimate, truth):
    """ATEMetric.cpp and RPEMetric.cpp in a few lines, after the alignment "original"."""
    placed = [truth[0] @ np.linalg.inv(estimate[0]) @ pose for pose in estimate]
    errors = [math.dist(e[:3, 3], t[:3, 3]) for e, t in zip(placed, truth, strict=True)]
    squares = []
    for i in range(1, len(placed)):
        moved = placed[i - 1] @ np.linalg.inv(placed[i])
        true = truth[i - 1] @ np.linalg.inv(truth[i])
        squares.append(np.linalg.norm((moved @ np.linalg.inv(true))[:3, 3]) ** 2)
    rmse = math.sqrt(sum(squares) / len(squares))
    return {"mean": sum(errors) / len(errors), "max": max(errors)}, rmse


def test_slambench_figures_are_those_of_its_programs():
    estimate, truth = wandering()
    figures = by_convention(estimate, truth)
    assert figures["slambench1"]["ate"] == pytest.approx(reference_slambench1(estimate, truth))
    assert figures["slambench1"]["rpe"] is None
    ate, rmse = reference_slambench2(estimate, truth)
    assert figures["slambench2"]["ate"] == pytest.approx(ate)
    assert figures["slambench2"]["rpe"]["rmse"] == pytest.approx(rmse)


def test_slambench1_does_not_turn_and_so_agrees_where_both_start_upright():
    estimate, truth = wandering()
    upright = np.linalg.inv(estimate[0]) @ estimate, np.linalg.inv(truth[0]) @ truth
    figures, turned = by_convention(*upright), by_convention(estimate, truth)
    assert figures["slambench1"]["ate"]["max"] == pytest.approx(figures["slambench2"]["ate"]["max"])
    assert turned["slambench1"]["ate"]["max"] > 10 * turned["slambench2"]["ate"]["max"]


def test_slambench2_new_is_the_first_pose_up_to_100_poses_and_a_similarity_beyond():
    estimate, truth = wandering()
    few = by_convention(estimate[:100], truth[:100])
    assert few["slambench2_new"]["ate"] == few["slambench2"]["ate"]
    # Spread over kilometres, so that the identity that its sum starts with does not matter.
    far = truth.copy()
    far[:, :3, 3] *= 1000
    scaled = far.copy()
    scaled[:, :3, 3] = 0.5 * far[:, :3, 3] + [1, 2, 3]
    assert by_convention(scaled, far)["slambench2_new"]["ate"]["max"] < 1e-2


def test_a_convention_that_is_not_defined_is_null():
    still = np.tile(np.eye(4), (120, 1, 1))
    figures = by_convention(still, still)
    assert figures["slambench2_new"] is None
    assert figures["slambench2"]["ate"] == {"mean": 0, "max": 0}
    assert by_convention(still[:1], still[:1])["tum"]["rpe"] is None
    assert set(figures) == set(CONVENTIONS)


def evo_trajectory(poses):
    trajectory = pytest.importorskip("evo.core.trajectory", reason="evo is not installed (GPL: not required)")
    stamps = np.arange(len(poses)) / 30
    quaternions = quaternion_from_rotation(poses[:, :3, :3])[:, [3, 0, 1, 2]]
    return trajectory.PoseTrajectory3D(poses[:, :3, 3], quaternions, stamps)


@pytest.mark.parametrize("alignment", ["first", "se3", "sim3"])
def test_evo_agrees_where_it_is_installed(tmp_path, capsys, alignment):
    metrics = pytest.importorskip("evo.core.metrics", reason="evo is not installed (GPL: not required)")
    estimate, truth = wandering()
    moved, true = evo_trajectory(estimate), evo_trajectory(truth)
    if alignment == "first":
        moved.align_origin(true)
    else:
        moved.align(true, correct_scale=alignment == "sim3")
    report = evaluated(tmp_path, capsys, alignment)
    ape = metrics.APE(metrics.PoseRelation.translation_part)
    ape.process_data((true, moved))
    for name, value in ape.get_all_statistics().items():
        if name != "sse":
            assert report[name] == pytest.approx(value, abs=1e-7), name
    for relation, part in (("translation_part", "translation"), ("rotation_angle_deg", "rotation_degrees")):
        rpe = metrics.RPE(metrics.PoseRelation[relation], 1, metrics.Unit.frames, all_pairs=True)
        rpe.process_data((true, moved))
        for name, value in rpe.get_all_statistics().items():
            if name != "sse":
                assert report["rpe"][part][name] == pytest.approx(value, abs=2e-6), (part, name)


@needs_real_data
def test_a_real_estimate_by_each_convention():
    folder = DATA / "trajectories/tum"
    estimate = Trajectory.read(folder / "freiburg1_xyz-rgbdslam.txt")
    true = Trajectory.read(folder / "freiburg1_xyz-groundtruth.txt")
    i, j = associate(estimate.timestamps, true.timestamps)
    figures = by_convention(estimate.poses[i], true.poses[j])
    assert figures["tum"]["ate"]["rmse"] == pytest.approx(0.013470, abs=5e-7)  # evo_ape tum --align
    assert figures["tum"]["rpe"]["rmse"] == pytest.approx(0.0057643708, abs=1e-9)  # evo_rpe --all_pairs
    assert figures["slambench2"]["ate"]["mean"] > figures["tum"]["ate"]["mean"]
