"""The rules by which a pose is refused, and what a refusal says of itself."""

from __future__ import annotations

import math
from collections.abc import Mapping
from enum import IntEnum
from typing import Any

from slam.plans.plan import State


class Refusal(IntEnum):
    """The rule of the kernel `check_pose` that refused a pose; kernels know it as REFUSED_<NAME>."""

    INLIERS = 1
    RESIDUAL = 2
    TRANSLATION = 3
    ROTATION = 4
    FAR_MOTION = 5
    OUTSIDE = 6


def reason(state: State, limits: Mapping[str, Any]) -> str | None:
    """Why the last pose check failed, with its figures; None where it passed.

    `state` is the state after the check, and `limits` are the arguments of its `check_pose`.
    """
    if not state["refusal"]:
        return None
    refusal, checks, inliers, overlap = (
        int(state[name]) for name in ("refusal", "misses", "inliers", "overlap")
    )  # a check that fails is a miss: the limits grow with them
    translation, rotation = float(state["translation"]), float(state["rotation"])
    share = inliers / limits["pixels"]
    if refusal == Refusal.INLIERS:
        return f"too few inliers: {share:.0%} of the pixels, {limits['min_inliers']:.0%} are needed"
    if refusal == Refusal.RESIDUAL:
        residual = math.sqrt(state["squared_error"] / inliers)
        return f"residual too large: {1e3 * residual:.1f} mm, {1e3 * limits['max_residual']:g} mm are allowed"
    if refusal == Refusal.TRANSLATION:
        allowed = checks * limits["max_translation"]
        return f"moved too far: {translation:.2f} m, {allowed:.2f} m are allowed"
    if refusal == Refusal.ROTATION:
        allowed = checks * limits["max_rotation"]
        return f"turned too far: {rotation:.2f} rad, {allowed:.2f} rad are allowed"
    if refusal == Refusal.OUTSIDE:
        return f"left the volume of {limits['volume_size']:g} m"
    return (
        f"too few inliers for a motion of {translation:.2f} m and {rotation:.2f} rad: "
        f"{share:.0%} of the pixels, {inliers / max(overlap, 1):.0%} of those that see the model"
    )
