"""The errors of an estimated trajectory against the truth, in every convention that papers use."""

from __future__ import annotations

from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from slam.trajectories.conventions import by_convention, statistics
from slam.trajectories.matching import match
from slam.trajectories.readings import Axes, mirror_y, reading_warnings
from slam.trajectories.trajectory import (
    MAXIMAL_STAMP_DIFFERENCE,
    Alignment,
    Trajectory,
    TrajectoryError,
    absolute_trajectory_error,
    align,
    relative_pose_error,
)


def evaluate(
    estimate: Trajectory,
    truth: Trajectory,
    alignment: Alignment = "first",
    delta: int = 1,
    maximal_difference: float = MAXIMAL_STAMP_DIFFERENCE,
    truth_axes: Axes = "opencv",
) -> dict[str, Any]:
    """Plain JSON values of the poses of both whose stamps lie within `maximal_difference` seconds.

    At the top the absolute error in metres with the chosen alignment; under "alignments" its RMSE with each,
    and the scale found; under "rpe" the relative error over `delta` matched frames, in metres and in degrees
    (after the alignment: sim3 stretches it), or None with too few pairs. "rmse_aligned" is that of se3.
    "matched_share" is the part of the estimate that was compared. "conventions" has the figures of other
    programs, each under its name (`slam.trajectories.conventions`). "warnings" names readings of the files
    by which they agree far better. A truth in the axes "y-up" is mirrored first.
    Raises TrajectoryError when too few stamps match, all are equal, or `delta` leaves no pair.
    """
    rows, partners = match(estimate.timestamps, truth.timestamps, maximal_difference)
    poses, true_poses = estimate.poses[rows], truth.poses[partners]
    if truth_axes == "y-up":
        true_poses = mirror_y(true_poses)
    error = absolute_trajectory_error(poses, true_poses, alignment)
    result: dict[str, Any] = {
        "align": alignment,
        "pairs": len(rows),
        "estimate_poses": len(estimate),
        "truth_poses": len(truth),
        "matched_share": len(rows) / len(estimate),
        **statistics(error.per_frame),
        "rmse_aligned": error.rmse_aligned,
        "alignments": {kind: _aligned(poses, true_poses, kind) for kind in get_args(Alignment)},
        "conventions": by_convention(poses, true_poses),
        "rpe": None,
        "warnings": reading_warnings(poses, true_poses, truth_axes),
    }
    if len(rows) > 1:
        moved, _ = align(poses, true_poses, alignment)
        relative = relative_pose_error(moved, true_poses, delta)
        result["rpe"] = {
            "delta": delta,
            "pairs": len(relative.translations),
            "translation": statistics(relative.translations),
            "rotation_degrees": statistics(relative.rotations),
        }
        result |= {"rpe_translation": relative.translation, "rpe_rotation_degrees": relative.rotation}
    return result


def _aligned(
    poses: NDArray[np.float64], truth: NDArray[np.float64], alignment: Alignment
) -> dict[str, float] | None:
    """RMSE and maximum after one alignment; None where it is not defined (an estimate that never moves)."""
    try:
        error = absolute_trajectory_error(poses, truth, alignment)
        _, scale = align(poses, truth, alignment)
    except TrajectoryError:
        return None
    return {"rmse": error.rmse, "max": error.max, "scale": scale}
