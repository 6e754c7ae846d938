"""Trajectory errors by the conventions of SLAMBench 1, SLAMBench 2 and TUM's benchmark.

The conventions differ in the alignment, so their figures must not be compared with each other. All take the
same matched poses here. The programs match stamps themselves: SLAMBench 1 by the frame's number, SLAMBench 2
with the next true pose in time, TUM with the nearest within 0.02 s, evo within 0.01 s.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slam.trajectories.trajectory import TrajectoryError, align, align_first_pose, relative_pose_error

Array = NDArray[np.float64]
ALIGNED_FROM = 101  # poses: with fewer, SLAMBench 2's alignment "new" is "original"


@dataclass(frozen=True)
class Convention:
    """One way to compare trajectories.

    `place` moves estimated poses (n, 4, 4) onto the true ones as the convention does. `ate` names the
    statistics of the distances, in metres, that its program prints. `rpe` takes placed and true poses; None
    where the program has no relative error.
    """

    alignment: str
    place: Callable[[Array, Array], Array]
    ate: tuple[str, ...]
    rpe: Callable[[Array, Array], dict[str, float]] | None


def shift_first_position(estimate: Array, truth: Array) -> Array:
    """Move the positions of `estimate` (n, 4, 4) so that the first lies on the truth's; nothing is turned.

    SLAMBench 1, kfusion/thirdparty/checkPos.py. Its log starts at the origin and its camera upright, as in
    ICL-NUIM. A truth that starts turned gives large errors. Its log is also one frame late: it writes each
    pose before the frame. Logs of this program write it after the frame.
    """
    moved = estimate.copy()
    moved[:, :3, 3] += truth[0, :3, 3] - estimate[0, :3, 3]
    return moved


def align_new(estimate: Array, truth: Array) -> Array:
    """SLAMBench 2's alignment "new" of `estimate` (n, 4, 4), TrajectoryAlignmentMethod.cpp.

    Up to 100 poses it is the alignment of the first pose. Else a similarity is fitted that maps the truth to
    the estimate, and its inverse is applied. The sum of outer products starts with the identity, which biases
    the rotation towards the identity for short trajectories: the original does so, too. Raises
    TrajectoryError where the true camera does not move or the fitted scale is 0.
    """
    if len(estimate) < ALIGNED_FROM:
        return align_first_pose(estimate, truth)
    model, data = truth[:, :3, 3], estimate[:, :3, 3]
    centred_model, centred_data = model - model.mean(axis=0), data - data.mean(axis=0)
    U, _, Vt = np.linalg.svd(np.eye(3) + centred_data.T @ centred_model)
    signs = np.array([1.0, 1.0, -1.0 if np.linalg.det(U) * np.linalg.det(Vt) < 0 else 1.0])
    R = (U * signs) @ Vt
    extent = np.sum(centred_model**2)
    scale = float(np.sum(centred_data * (centred_model @ R.T)) / extent) if extent > 0 else 0.0
    if scale == 0:
        raise TrajectoryError(
            "a camera that never moves has no scale, which SLAMBench 2's alignment new needs"
        )
    fitted = np.eye(4)
    fitted[:3, :3] = scale * R
    fitted[:3, 3] = data.mean(axis=0) - scale * R @ model.mean(axis=0)
    return np.asarray(np.linalg.inv(fitted) @ estimate)


def slambench2_rpe(placed: Array, truth: Array) -> dict[str, float]:
    """ "rmse" in metres over consecutive poses, as SLAMBench 2's RPEMetric.cpp computes it.

    The motion is P_i P_j^-1, not P_i^-1 P_j as in TUM's benchmark: it is seen from the world, so that it
    depends on how far the camera is from the origin.
    """
    steps = placed[:-1] @ np.linalg.inv(placed[1:])
    true_steps = truth[:-1] @ np.linalg.inv(truth[1:])
    excess = steps @ np.linalg.inv(true_steps)
    return {"rmse": float(np.sqrt(np.mean(np.sum(excess[:, :3, 3] ** 2, axis=1))))}


def tum_rpe(placed: Array, truth: Array) -> dict[str, float]:
    """ "rmse" in metres and "rmse_degrees" over consecutive poses, as TUM's evaluate_rpe.py computes them."""
    relative = relative_pose_error(placed, truth)
    return {"rmse": relative.translation, "rmse_degrees": relative.rotation}


def _rigid(estimate: Array, truth: Array) -> Array:
    return align(estimate, truth, "se3")[0]


CONVENTIONS = {
    "slambench1": Convention("first position", shift_first_position, ("min", "max", "mean"), None),
    "slambench2": Convention("first pose (original)", align_first_pose, ("mean", "max"), slambench2_rpe),
    "slambench2_new": Convention("similarity (new)", align_new, ("mean", "max"), slambench2_rpe),
    "tum": Convention(
        "rigid (Horn, Umeyama without scale)",
        _rigid,
        ("rmse", "mean", "median", "std", "min", "max"),
        tum_rpe,
    ),
}


def by_convention(estimate: Array, truth: Array) -> dict[str, dict[str, Any] | None]:
    """The figures of each of CONVENTIONS for matched poses (n, 4, 4), all of them known.

    A convention's entry has "alignment", "ate" (metres) and "rpe" (over consecutive poses; None with one pose
    or where the convention has none); it is None where its alignment is not defined. "tum" is what `evo_ape
    --align` and `evo_rpe --all_pairs` print, with "rmse_degrees" of `--pose_relation angle_deg`.
    """
    return {name: _figures(convention, estimate, truth) for name, convention in CONVENTIONS.items()}


def _figures(convention: Convention, estimate: Array, truth: Array) -> dict[str, Any] | None:
    try:
        placed = convention.place(estimate, truth)
    except TrajectoryError:
        return None
    errors = np.linalg.norm(placed[:, :3, 3] - truth[:, :3, 3], axis=1)
    figures = statistics(errors)
    return {
        "alignment": convention.alignment,
        "ate": {name: figures[name] for name in convention.ate},
        "rpe": convention.rpe(placed, truth) if convention.rpe and len(placed) > 1 else None,
    }


def statistics(errors: Array) -> dict[str, float]:
    """The statistics of a list of errors under the names of `evo`, without the sum of squares."""
    return {
        "mean": float(errors.mean()),
        "median": float(np.median(errors)),
        "min": float(errors.min()),
        "max": float(errors.max()),
        "std": float(errors.std()),
        "rmse": float(np.sqrt(np.mean(errors**2))),
    }
