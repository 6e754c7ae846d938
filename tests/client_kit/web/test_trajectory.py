"""The trajectory's error and deviation in JavaScript are Python's."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from client_kit.delivery.reference_trajectories import deviation
from slam.datasets import open_sequence
from slam.trajectories.trajectory import Trajectory, absolute_trajectory_error, associate
from tests.client_kit.web.serving import evaluated
from tests.shipped import KFUSION, LIVING_ROOM
from tests.slam.numpy_kernels.dense import exponential

ERRORS = """async (pairs) => {
    const { absoluteTrajectoryError } = await import("/measure/trajectory.js");
    return pairs.map(([estimate, truth]) => absoluteTrajectoryError(estimate, truth));
}"""
DEVIATIONS = """async (pairs) => {
    const { deviation } = await import("/measure/trajectory.js");
    return pairs.map(([positions, reference]) => {
        const far = deviation(positions, reference);
        return Number.isFinite(far) ? far : String(far);
    });
}"""


def rows(poses: np.ndarray) -> list[list[float] | None]:
    """The poses as a pack's header holds them."""
    return [pose[:3].ravel().tolist() if np.isfinite(pose).all() else None for pose in poses]


def shipped_estimates() -> list[tuple[np.ndarray, np.ndarray]]:
    """The true poses of the shipped sequence, and poses at the front's trajectories, rotated as well."""
    truth = open_sequence(LIVING_ROOM).truth
    assert truth is not None
    pairs = []
    for seed, configuration in enumerate(json.loads(KFUSION.read_text(encoding="utf-8"))["configurations"]):
        random = np.random.default_rng(seed)
        estimate = truth @ np.array([exponential(twist) for twist in random.normal(0, 0.01, (len(truth), 6))])
        estimate[:, :3, 3] = configuration["trajectory"]
        partial = truth.copy()
        partial[random.random(len(truth)) < 0.1 * (seed % 3)] = np.nan
        pairs.append((estimate.astype(np.float32).astype(float), partial))
    return pairs


def recorded_estimates() -> list[tuple[np.ndarray, np.ndarray]]:
    """Real estimates of the TUM benchmark with their ground truth, where they lie beside the checkout."""
    folder = Path(os.environ.get("FRONTRUNNER_DATA", "no-data")) / "trajectories" / "tum"
    pairs = []
    for estimate, truth in (
        ("freiburg1_xyz-rgbdslam.txt", "freiburg1_xyz-groundtruth.txt"),
        ("fr2_desk_ORB.txt", "fr2_desk_groundtruth.txt"),
    ):
        if (folder / estimate).exists():
            one, other = Trajectory.read(folder / estimate), Trajectory.read(folder / truth)
            left, right = associate(one.timestamps, other.timestamps)
            pairs.append((one.poses[left], other.poses[right]))
    return pairs


def compare(page: Any, pairs: list[tuple[np.ndarray, np.ndarray]]) -> None:
    computed = evaluated(page, ERRORS, [(rows(estimate), rows(truth)) for estimate, truth in pairs])
    for (estimate, truth), errors in zip(pairs, computed, strict=True):
        expected = absolute_trajectory_error(estimate, truth)
        for name in ("max", "mean", "rmse"):
            assert errors[name] == pytest.approx(getattr(expected, name), abs=1e-6)


@pytest.mark.slow
def test_the_error_is_that_of_python_on_the_shipped_sequence(web_page: Any) -> None:
    compare(web_page, shipped_estimates())


@pytest.mark.slow
def test_the_error_is_that_of_python_on_recorded_trajectories(web_page: Any) -> None:
    pairs = recorded_estimates()
    if not pairs:
        pytest.skip("no recorded trajectories: FRONTRUNNER_DATA names no folder that has them")
    compare(web_page, pairs)


def test_without_a_true_pose_there_is_no_error(web_page: Any) -> None:
    assert web_page.evaluate(ERRORS, [(rows(np.eye(4)[None]), [None])]) == [None]


def test_an_estimate_that_is_not_finite_has_no_finite_error(web_page: Any) -> None:
    poses = rows(np.array([np.eye(4), np.eye(4)]))
    script = ERRORS.replace("estimate, truth)", "[...estimate, new Array(12).fill(NaN)].slice(1), truth).max")

    assert np.isnan(web_page.evaluate(script, [(poses, poses)])[0])


def test_the_deviation_is_that_of_python(web_page: Any) -> None:
    pairs = []
    for configuration in json.loads(KFUSION.read_text(encoding="utf-8"))["configurations"]:
        reference = np.array(configuration["trajectory"])
        noise = np.random.default_rng(len(pairs)).normal(0, 0.01, reference.shape)
        pairs.append(((reference + noise).tolist(), reference.tolist()))

    deviations = evaluated(web_page, DEVIATIONS, pairs)

    assert deviations == pytest.approx([deviation(*pair) for pair in pairs], abs=1e-12)


def test_the_deviation_of_a_position_that_is_not_finite_is_not_a_number(web_page: Any) -> None:
    assert web_page.evaluate(DEVIATIONS.replace("(positions, reference)", "([[NaN, 0, 0]], reference)"),
                             [[[], [[0, 0, 0]]]]) == ["NaN"]  # fmt: skip


def test_trajectories_of_different_lengths_are_refused(web_page: Any) -> None:
    for script in (ERRORS, DEVIATIONS):
        with pytest.raises(Exception, match="RangeError"):
            web_page.evaluate(script, [[[], [[0, 0, 0]]]])
