"""What kernels take besides images: the state and a camera."""

from __future__ import annotations

import numpy as np

from slam.camera import Camera
from slam.kfusion.declarations import ADAPTIVE_MEMBERS, MEMBERS
from slam.plans.plan import TYPES, Member
from tests.slam.numpy_kernels.dense import exponential

ADAPTIVE = MEMBERS + ADAPTIVE_MEMBERS  # of configurations that adapt


def state_of(pose: np.ndarray, members: tuple[Member, ...] = MEMBERS, **values: object) -> np.ndarray:
    """The state () of `members` at `pose` (4, 4), with other values."""
    kinds = [(each.name, TYPES[each.type], (each.count,) if each.count > 1 else ()) for each in members]
    state = np.zeros((), np.dtype(kinds))
    state["pose"] = pose[:3].ravel()
    for name, value in values.items():
        state[name] = value
    return state


def camera_of(camera: Camera) -> tuple[float, ...]:
    """`camera` as a vec4f: fx, fy, cx, cy."""
    return (camera.fx, camera.fy, camera.cx, camera.cy)


def pose_at(
    position: tuple[float, float, float], twist: tuple[float, float, float] = (0, 0, 0)
) -> np.ndarray:
    """A camera's pose (4, 4) at `position` (m), turned by `twist` (radians)."""
    pose = exponential(np.array([0, 0, 0, *twist], float))
    pose[:3, 3] = position
    return pose
