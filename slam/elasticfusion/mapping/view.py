"""The view of a camera on the map, as kernels read it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slam.devices.opencl import Session
from slam.elasticfusion.configuration import FARTHEST

# The layout of `kernels/view.h`.
VIEW = np.dtype(
    [
        ("matrix", np.float32, 12),
        ("farthest", np.float32),
        ("confidence", np.float32),
        ("first", np.int32),
        ("last", np.int32),
    ]
)


def view_of(pose: NDArray[np.float64], seen: tuple[int, int], confidence: float) -> NDArray[np.void]:
    """One VIEW: from `pose` (4, 4; camera to world) surfels of at least this confidence that were last seen
    at a tick from seen[0] to seen[1], both included.
    """
    view = np.zeros(1, VIEW)
    view["matrix"] = np.linalg.inv(pose)[:3].ravel()
    view["farthest"], view["confidence"] = FARTHEST, confidence
    view["first"], view["last"] = seen
    return view


class View:
    """A VIEW on the device, which kernels are bound to once."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self.buffer = session.buffer(VIEW.itemsize, "a view")

    def show(self, pose: NDArray[np.float64], seen: tuple[int, int], confidence: float) -> None:
        """Set what kernels see from now on (as `view_of`)."""
        self._session.upload(self.buffer, view_of(pose, seen, confidence))
