"""Camera trajectories: TUM files, association, alignment, absolute and relative error.

Poses are float64 (n, 4, 4), camera to world, OpenCV axes, metres. A pose that is not known (a frame outside
the ground truth) is a matrix of NaN.
"""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt

from slam.trajectories.stamps import LARGEST_STAMP, in_seconds
from slam.trajectories.text_files import read_text

Array = npt.NDArray[np.float64]
Alignment = Literal["first", "se3", "sim3"]

MAXIMAL_STAMP_DIFFERENCE = 0.01  # seconds, as evo; TUM's own script takes 0.02
ROTATION_TOLERANCE = 1e-3  # of each element of R^T R - 1: poses are written with four digits and more
LARGEST_POSITION = 1e6  # metres: beyond lies damage


class TrajectoryError(ValueError):
    """A trajectory that cannot be read, matched or aligned; the message says which and why."""


@dataclass(frozen=True)
class Trajectory:
    """Stamped poses: `timestamps` float64 (n,) in seconds, `poses` float64 (n, 4, 4)."""

    timestamps: Array
    poses: Array

    def __post_init__(self) -> None:
        if self.timestamps.ndim != 1 or self.poses.shape != (len(self.timestamps), 4, 4):
            raise TrajectoryError(
                f"{self.timestamps.shape} timestamps and {self.poses.shape} poses do not belong together: "
                "give (n,) and (n, 4, 4)"
            )

    def __len__(self) -> int:
        return len(self.timestamps)

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Trajectory:
        """Read a TUM file: a line `t tx ty tz qx qy qz qw` per pose, `#` starts a comment.

        Quaternions are normalised. Stamps may be nanoseconds since 1970. Raises TrajectoryError naming the
        line that is not a pose.
        """
        stamps, positions, quaternions = [], [], []
        lines = read_text(Path(path), TrajectoryError).splitlines()
        for number, line in enumerate(lines, start=1):
            text = line.split("#", 1)[0].replace(",", " ").split()
            if not text:
                continue
            try:
                values = [float(item) for item in text]
            except ValueError:
                values = []
            if len(values) != 8 or not all(map(math.isfinite, values)):
                raise TrajectoryError(
                    f"{path}, line {number}: {line[:60]!r} is not a pose: write t tx ty tz qx qy qz qw"
                )
            stamp = in_seconds(values[0])
            if stamp is None or max(map(abs, values[1:4])) > LARGEST_POSITION:
                raise TrajectoryError(
                    f"{path}, line {number}: {line[:60]!r} is out of range: write seconds up to "
                    f"{LARGEST_STAMP:g} and metres up to {LARGEST_POSITION:g}"
                )
            if not 1e-6 <= math.hypot(*values[4:]) <= 1e6:
                raise TrajectoryError(
                    f"{path}, line {number}: the quaternion {' '.join(text[4:])} is not a rotation: "
                    "write qx qy qz qw of length 1"
                )
            stamps.append(stamp)
            positions.append(values[1:4])
            quaternions.append(values[4:])
        if not stamps:
            raise TrajectoryError(f"{path} holds no pose: write t tx ty tz qx qy qz qw, one line a frame")
        poses = np.tile(np.eye(4), (len(stamps), 1, 1))
        poses[:, :3, :3] = rotation_from_quaternion(np.array(quaternions))
        poses[:, :3, 3] = positions
        return cls(np.array(stamps), poses)

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write a TUM file, one line a pose; poses that are not known are left out."""
        known = np.isfinite(self.poses).all(axis=(1, 2))
        quaternions = quaternion_from_rotation(self.poses[known, :3, :3])
        rows = np.column_stack([self.timestamps[known], self.poses[known, :3, 3], quaternions])
        lines = [" ".join([f"{row[0]:.6f}", *(f"{value:.9f}" for value in row[1:])]) for row in rows]
        header = "# timestamp tx ty tz qx qy qz qw; camera to world, OpenCV axes, metres\n"
        Path(path).write_text(header + "".join(line + "\n" for line in lines), encoding="utf-8")


def check_poses(poses: Array, source: object, what: str = "pose") -> None:
    """Raise TrajectoryError for the first of `poses` (n, 4, 4) that is not a rigid motion; NaN is a gap.

    The upper left 3x3 must lie in SO(3) (R^T R = 1 within ROTATION_TOLERANCE, determinant above 0), the last
    row must be 0 0 0 1, the position at most LARGEST_POSITION metres. A pose that is NaN throughout is not
    known, which is allowed. The message names `source`, `what` and the pose's number.
    """
    known = ~np.isnan(poses[:, :3]).all(axis=(1, 2))
    with np.errstate(all="ignore"):
        rotations = poses[:, :3, :3]
        products = np.swapaxes(rotations, 1, 2) @ rotations
        excess: Array = np.abs(products - np.eye(3)).max(axis=(1, 2))
        turned = (excess <= ROTATION_TOLERANCE) & (_determinants(rotations) > 0)
        near = np.abs(poses[:, :3, 3]).max(axis=1) <= LARGEST_POSITION
        ends = np.abs(poses[:, 3] - [0, 0, 0, 1]).max(axis=1) <= ROTATION_TOLERANCE
    bad = known & ~(turned & near & ends)  # a comparison with NaN is false, so NaN is bad
    if not bad.any():
        return
    number = int(np.argmax(bad))
    if not turned[number]:
        reason = f"its 3x3 part is not a rotation (R^T R differs from 1 by {excess[number]:.3g})"
    elif not near[number]:
        x, y, z = poses[number, :3, 3]
        reason = f"its position {x:g} {y:g} {z:g} is not within {LARGEST_POSITION:g} m"
    else:
        reason = "its last row is not 0 0 0 1"
    raise TrajectoryError(f"{source}: {what} {number} is not a pose: {reason}: correct it or leave it out")


def _determinants(matrices: Array) -> Array:
    """Determinants (n,) of `matrices` (n, 3, 3) as triple products, which pass NaN and infinity on."""
    normals = np.cross(matrices[:, :, 0], matrices[:, :, 1])
    return np.asarray(np.sum(normals * matrices[:, :, 2], axis=1))


def rotation_from_quaternion(quaternions: Array) -> Array:
    """Rotations (n, 3, 3) of quaternions (n, 4) in the order x y z w, of any norm but zero."""
    x, y, z, w = (quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def quaternion_from_rotation(rotations: Array) -> Array:
    """Unit quaternions (n, 4), order x y z w and w >= 0, of rotations (n, 3, 3).

    The largest of the four components is computed from the diagonal and the others from it, so that no
    rotation divides by a small number (Shepperd 1978).
    """
    trace = np.trace(rotations, axis1=1, axis2=2)
    diagonal = np.diagonal(rotations, axis1=1, axis2=2)
    largest = np.argmax(np.column_stack([diagonal, trace]), axis=1)
    quaternions = np.empty((len(rotations), 4))
    for row, (R, i) in enumerate(zip(rotations, largest, strict=True)):
        if i == 3:
            w = 1 + trace[row]
            quaternions[row] = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], w
        else:
            j, k = (i + 1) % 3, (i + 2) % 3
            quaternions[row, i] = 1 + R[i, i] - R[j, j] - R[k, k]
            quaternions[row, j] = R[i, j] + R[j, i]
            quaternions[row, k] = R[i, k] + R[k, i]
            quaternions[row, 3] = R[k, j] - R[j, k]
    quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    quaternions[quaternions[:, 3] < 0] *= -1
    return quaternions


def associate(
    first: Array, second: Array, maximal_difference: float = MAXIMAL_STAMP_DIFFERENCE
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Pair two lists of stamps as the TUM benchmark does: closest pairs first, every stamp at most once.

    Returns the indices into `first` and `second` of the pairs, in the order of `first`'s stamps. Pairs lie
    less than `maximal_difference` seconds apart; stamps without such a partner are left out.
    """
    order = np.argsort(second, kind="stable")
    candidates: list[tuple[float, int, int]] = []
    begins = np.searchsorted(second[order], first - maximal_difference, side="left")
    ends = np.searchsorted(second[order], first + maximal_difference, side="right")
    for i, (begin, end) in enumerate(zip(begins, ends, strict=True)):
        for j in order[begin:end]:
            difference = abs(float(first[i] - second[j]))
            if difference < maximal_difference:
                candidates.append((difference, i, int(j)))
    taken_first: dict[int, int] = {}
    taken_second: set[int] = set()
    for _, i, j in sorted(candidates):
        if i not in taken_first and j not in taken_second:
            taken_first[i] = j
            taken_second.add(j)
    pairs = sorted(taken_first.items(), key=lambda pair: (first[pair[0]], pair[0]))
    left, right = [i for i, _ in pairs], [j for _, j in pairs]
    return np.array(left, dtype=np.intp), np.array(right, dtype=np.intp)


def align_first_pose(estimate: Array, truth: Array) -> Array:
    """Move `estimate` (n, 4, 4) rigidly so that its first pose is the truth's: GT_0 EST_0^-1 EST_i."""
    aligned: Array = truth[0] @ np.linalg.inv(estimate[0]) @ estimate
    return aligned


def umeyama(source: Array, target: Array, *, with_scale: bool) -> tuple[Array, Array, float]:
    """The rotation R (3, 3), translation t (3,) and scale s that minimise |target - (s R source + t)|^2.

    Positions are (n, 3). Umeyama 1991, eqs. 34 to 43; without scale it is Horn's alignment of the TUM
    benchmark. Raises TrajectoryError when a scale is asked for and the source never moves.
    """
    source_mean, target_mean = source.mean(axis=0), target.mean(axis=0)
    covariance = (target - target_mean).T @ (source - source_mean) / len(source)
    U, singular, Vt = np.linalg.svd(covariance)
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(U) * np.linalg.det(Vt)) or 1.0])
    R = (U * signs) @ Vt
    scale = 1.0
    if with_scale:
        variance = np.mean(np.sum((source - source_mean) ** 2, axis=1))
        if variance == 0:
            raise TrajectoryError("the estimate never moves, so it has no scale: align it with se3")
        scale = float(singular @ signs / variance)
    return R, target_mean - scale * R @ source_mean, scale


@dataclass(frozen=True)
class AbsoluteTrajectoryError:
    """Distances in metres between true and estimated positions.

    `per_frame` (n,) holds NaN where the truth is not known; the figures ignore those frames. `rmse_aligned`
    is the `rmse` after a rigid Umeyama alignment whatever alignment the other figures use.
    """

    mean: float
    max: float
    rmse: float
    rmse_aligned: float
    per_frame: Array = field(repr=False)


def absolute_trajectory_error(
    estimate: Array, truth: Array, alignment: Alignment = "first"
) -> AbsoluteTrajectoryError:
    """Compare poses (n, 4, 4) with the truth of the same frames.

    "first" puts the first known pair of poses on top of each other (SLAMBench), "se3" and "sim3" minimise
    the squared distances over all frames without and with a scale (TUM). Raises TrajectoryError when the
    lengths differ, an estimated pose is not finite, a true one is not a rigid motion, or no frame has a
    truth.
    """
    if estimate.shape != truth.shape or estimate.shape[1:] != (4, 4):
        raise TrajectoryError(f"estimate {estimate.shape} and truth {truth.shape} must both be (n, 4, 4)")
    known = np.isfinite(truth).all(axis=(1, 2))
    if not known.any():
        raise TrajectoryError(f"none of the {len(truth)} frames has a true pose to compare with")
    if not np.isfinite(estimate).all():
        frame = int(np.argmax(~np.isfinite(estimate).all(axis=(1, 2))))
        raise TrajectoryError(f"the estimated pose of frame {frame} is not finite: repeat the last good one")
    check_poses(truth, "the truth", "the pose of frame")
    paired, target = estimate[known], truth[known, :3, 3]
    rigid = _residuals(paired, target, "se3")
    if alignment == "first":
        errors = np.linalg.norm(align_first_pose(paired, truth[known])[:, :3, 3] - target, axis=1)
    else:
        errors = rigid if alignment == "se3" else _residuals(paired, target, alignment)
    per_frame = np.full(len(truth), np.nan)
    per_frame[known] = errors
    return AbsoluteTrajectoryError(
        mean=float(errors.mean()),
        max=float(errors.max()),
        rmse=_root_mean_square(errors),
        rmse_aligned=_root_mean_square(rigid),
        per_frame=per_frame,
    )


def _residuals(estimate: Array, target: Array, alignment: Alignment) -> Array:
    source = estimate[:, :3, 3]
    R, t, scale = umeyama(source, target, with_scale=alignment == "sim3")
    return np.asarray(np.linalg.norm(scale * source @ R.T + t - target, axis=1))


def _root_mean_square(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def align(estimate: Array, truth: Array, alignment: Alignment) -> tuple[Array, float]:
    """Poses (n, 4, 4) moved onto the truth as absolute_trajectory_error does, and their scale.

    All true poses must be known. The scale is 1 except for "sim3", which also stretches the positions.
    """
    if alignment == "first":
        return align_first_pose(estimate, truth), 1.0
    R, t, scale = umeyama(estimate[:, :3, 3], truth[:, :3, 3], with_scale=alignment == "sim3")
    moved = estimate.copy()
    moved[:, :3, :3] = R @ estimate[:, :3, :3]
    moved[:, :3, 3] = scale * estimate[:, :3, 3] @ R.T + t
    return moved, scale


@dataclass(frozen=True)
class RelativePoseError:
    """Drift over a fixed number of frames: RMSE in metres and in degrees, and the values of every pair.

    A drift is the difference between the estimated and the true motion between two frames.
    """

    translation: float
    rotation: float
    translations: Array = field(repr=False)
    rotations: Array = field(repr=False)


def relative_pose_error(estimate: Array, truth: Array, delta: int = 1) -> RelativePoseError:
    """The TUM benchmark's relative pose error over `delta` frames (Sturm et al. 2012, eqs. 1 and 2).

    Pairs of which one truth is not known are left out. Raises TrajectoryError when no pair is left.
    """
    if estimate.shape != truth.shape or delta < 1:
        raise TrajectoryError(
            f"estimate {estimate.shape}, truth {truth.shape}, delta {delta}: no pair of frames"
        )
    true_steps = np.linalg.inv(truth[:-delta]) @ truth[delta:]
    steps = np.linalg.inv(estimate[:-delta]) @ estimate[delta:]
    known = np.isfinite(true_steps).all(axis=(1, 2))
    if not known.any():
        raise TrajectoryError(f"{len(truth)} frames hold no two known poses {delta} frames apart")
    error = np.linalg.inv(true_steps[known]) @ steps[known]
    # The sine keeps its precision near zero, where the arc cosine of the trace loses half the digits.
    axis = np.stack(
        [error[:, 2, 1] - error[:, 1, 2], error[:, 0, 2] - error[:, 2, 0], error[:, 1, 0] - error[:, 0, 1]]
    )
    cosine = (np.trace(error[:, :3, :3], axis1=1, axis2=2) - 1) / 2
    angles = np.degrees(np.arctan2(np.linalg.norm(axis, axis=0) / 2, cosine))
    lengths = np.linalg.norm(error[:, :3, 3], axis=1)
    return RelativePoseError(_root_mean_square(lengths), _root_mean_square(angles), lengths, angles)
