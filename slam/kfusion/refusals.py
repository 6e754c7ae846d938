"""The rules by which a pose is refused, and their figures."""

from __future__ import annotations

from enum import IntEnum


class Refusal(IntEnum):
    """The rule of `check_pose` that refused a pose; the kernels know it as REFUSED_<NAME>."""

    INLIERS = 1
    RESIDUAL = 2
    TRANSLATION = 3
    ROTATION = 4
    FAR_MOTION = 5
    OUTSIDE = 6
