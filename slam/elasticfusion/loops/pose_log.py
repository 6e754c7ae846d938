"""The estimated trajectory: poses that later loops correct."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slam.elasticfusion.loops.graph import Deformation

Array = NDArray[np.float64]


class PoseLog:
    """One pose a frame, camera to world, with the tick at which it was taken."""

    def __init__(self) -> None:
        self._poses: list[Array] = []
        self._ticks: list[int] = []

    def append(self, pose: Array, tick: int) -> None:
        self._poses.append(np.array(pose, dtype=np.float64))
        self._ticks.append(tick)

    def poses(self) -> Array:
        """All poses (n, 4, 4) in the order of the frames, as corrected so far."""
        return np.array(self._poses).reshape(-1, 4, 4)

    def deform(self, deformation: Deformation) -> None:
        """Move all poses with the map."""
        self._poses = list(deformation.of_poses(self.poses(), np.array(self._ticks, dtype=np.int64)))
