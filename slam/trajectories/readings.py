"""Readings of a trajectory file that are easily confused: the order of a quaternion, and where y points."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from slam.trajectories.trajectory import align_first_pose, quaternion_from_rotation, rotation_from_quaternion

Array = npt.NDArray[np.float64]
Axes = Literal["opencv", "y-up"]  # y-up: ICL-NUIM's, which are OpenCV's with y mirrored
AXES: tuple[Axes, ...] = get_args(Axes)
MIRROR_Y = np.diag([1.0, -1.0, 1.0, 1.0])

FAR_BETTER = 3.0  # times smaller: neither noise nor drift does that
LEAST_ANGLE = 1.0  # degrees: a smaller disagreement proves nothing
LEAST_DISTANCE = 0.01  # metres


def mirror_y(poses: Array) -> Array:
    """Poses (n, 4, 4) between OpenCV axes and axes with y up; it is its own inverse.

    Camera and world are both mirrored, so rotations stay rotations, and an fy of -480 becomes 480.
    """
    return np.asarray(MIRROR_Y @ poses @ MIRROR_Y)


def w_first(poses: Array) -> Array:
    """`poses` (n, 4, 4), read in the order qx qy qz qw, as they are in the order qw qx qy qz."""
    again = poses.copy()
    again[:, :3, :3] = rotation_from_quaternion(quaternion_from_rotation(poses[:, :3, :3])[:, [1, 2, 3, 0]])
    return again


def reading_warnings(estimate: Array, truth: Array, axes: Axes) -> list[str]:
    """A sentence for each other reading by which matched poses (n, 4, 4) agree far better.

    All poses must be known. `axes` are those that the truth was read in. Rotations show the order of a
    quaternion, positions a mirrored y; both are compared with the first poses laid on each other.
    """
    warnings = []
    angles = {
        "the estimate": _mean_angle(w_first(estimate), truth),
        "the truth": _mean_angle(estimate, w_first(truth)),
    }
    which, angle = min(angles.items(), key=lambda item: item[1])
    present = _mean_angle(estimate, truth)
    if present > max(LEAST_ANGLE, FAR_BETTER * angle):
        warnings.append(
            f"rotations differ by {present:.1f} degrees on average, and by {angle:.1f} if the quaternions of "
            f"{which} are written w first: write qx qy qz qw"
        )
    distance, mirrored = _mean_distance(estimate, truth), _mean_distance(estimate, mirror_y(truth))
    if distance > max(LEAST_DISTANCE, FAR_BETTER * mirrored):
        other = next(name for name in AXES if name != axes)
        warnings.append(
            f"positions differ by {100 * distance:.1f} cm on average, and by {100 * mirrored:.1f} cm if y of "
            f"the truth is mirrored: give --truth-axes {other}"
        )
    return warnings


def _mean_angle(estimate: Array, truth: Array) -> float:
    """The mean angle, degrees, between rotations since the first pose."""
    turned = np.swapaxes(truth[:, :3, :3], 1, 2) @ align_first_pose(estimate, truth)[:, :3, :3]
    cosines = (np.trace(turned, axis1=1, axis2=2) - 1) / 2
    return float(np.degrees(np.arccos(np.clip(cosines, -1, 1))).mean())


def _mean_distance(estimate: Array, truth: Array) -> float:
    """The mean distance, metres, of positions."""
    moved = align_first_pose(estimate, truth)
    return float(np.linalg.norm(moved[:, :3, 3] - truth[:, :3, 3], axis=1).mean())
