"""The kernels of slam.kfusion that adapt to the motion, in NumPy, under their own names.

Both take members of the state by name and return all of them after the kernel. Poses are (4, 4) camera to
volume, several of them (n, 4, 4), float64.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.slam.numpy_kernels.kfusion import rotation_between, turned

Array = NDArray[np.float64]
Members = Mapping[str, Any]


@dataclass(frozen=True)
class Limits:
    """The parameters of `adapt`."""

    skip_limit: int
    skip_translation: float
    skip_rotation: float
    integrate_translation: float
    integrate_rotation: float
    kept_inliers: float
    decay: float
    cautious: int
    early: int


def predict(before: Members, most_extrapolated: int) -> dict[str, Any]:
    """ICP starts at the expected pose where frames were skipped, or turned by all frames since a lost one."""
    left_out = before["skip"]
    after = {**before, "left_out": left_out, "skip": 0, "elapsed": before["elapsed"] + left_out + 1}
    if before["recovering"] and before["misses"] < most_extrapolated:
        unseen = after["elapsed"] - (before["misses"] + 1)
        after["pose"] = turned(before["pose"], unseen * before["turn"])
    elif left_out and not before["recovering"]:
        after["pose"] = before["ahead"][left_out]
    return {**after, "start": after["pose"]}


def adapt(before: Members, limits: Limits) -> dict[str, Any]:
    """How many frames are skipped next, the expected poses, and whether the next tracked frame is fused."""
    if not before["tracked"]:
        return {**before, "fusing": 1}
    pose, frames = before["pose"], before["elapsed"]
    velocity = (pose - before["previous"])[:3, 3] / frames
    turn = rotation_between(before["previous"], pose) / frames
    push = np.linalg.norm(velocity - before["velocity"]) / frames
    twist = np.linalg.norm(turn - before["last_turn"]) / frames

    astray = before["left_out"] and is_farther(
        before["start"], pose, limits.skip_translation, limits.skip_rotation
    )
    caution = limits.cautious if astray else max(before["caution"] - 1, 0)
    most_inliers = max(before["last_inliers"], limits.decay * before["most_inliers"])
    enough = before["last_inliers"] >= limits.kept_inliers * most_inliers
    possible = [
        skip
        for skip in range(1, limits.skip_limit + 1)
        if motion_until(skip + 2, velocity, push) < limits.skip_translation
        and motion_until(skip + 2, turn, twist) < limits.skip_rotation
    ]
    still = before["adapted"] and enough and not caution and not before["recovering"]
    skip = max(possible, default=0) if still else 0

    expected = [moved(pose, number * velocity, number * turn) for number in range(1, skip + 2)]
    fused = pose if before["fusing"] else before["fused"]
    far = is_farther(fused, expected[-1], limits.integrate_translation, limits.integrate_rotation)
    early = before["adapted"] < limits.early
    return {
        **before,
        "turn": turn,
        "last_turn": turn,
        "velocity": velocity,
        "elapsed": 0,
        "caution": caution,
        "most_inliers": most_inliers,
        "fused": fused,
        "skip": skip,
        "ahead": np.array([*expected, *before["ahead"][len(expected) :]]),
        "fusing": int(early or before["recovering"] > 0 or far),
        "adapted": before["adapted"] + early,
    }


def motion_until(frame: int, speed: Array, gain: float) -> float:
    """How far a motion comes by `frame` that begins with `speed` a frame and gains `gain` in each."""
    return float(frame * np.linalg.norm(speed) + 0.5 * gain * frame**2)


def is_farther(one: Array, other: Array, translation: float, rotation: float) -> bool:
    """Whether two poses differ by more than `translation` (m) or `rotation` (radians)."""
    return bool(
        np.linalg.norm(other[:3, 3] - one[:3, 3]) > translation
        or np.linalg.norm(rotation_between(one, other)) > rotation
    )


def moved(pose: Array, translation: Array, rotation: Array) -> Array:
    """A camera moved in the volume's axes, and turned by a rotation vector in them."""
    after = turned(pose, rotation)
    after[:3, 3] += translation
    return after
