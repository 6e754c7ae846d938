"""What every SLAM system is given, and what it offers to the benchmark."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from slam.camera import Camera

STAGES = ("preprocessing", "tracking", "integration", "raycasting")


@dataclass(frozen=True)
class Frame:
    """What a system says of one frame.

    pose: float64 (4, 4), camera to world, after the frame. tracked: True, False (lost), or None where
    tracking was not attempted. seconds: wall time of each of STAGES.
    """

    pose: NDArray[np.float64]
    tracked: bool | None
    integrated: bool
    seconds: dict[str, float]


@dataclass(frozen=True)
class View:
    """The model as the camera sees it: float32 maps (height, width, 3), zero where there is nothing.

    vertices: metres in the system's world. normals: of unit length. eye: the camera's centre (3,).
    """

    vertices: NDArray[np.float32]
    normals: NDArray[np.float32]
    eye: NDArray[np.float32]


class System(Protocol):
    """A SLAM system that is fed depth images one by one."""

    def process(self, depth: NDArray[np.uint16]) -> Frame:
        """Take the next depth image, (height, width) in millimetres, 0 where nothing was measured."""

    def configuration(self) -> dict[str, Any]:
        """The parameters that this system runs with, by their names in the design space."""

    def view(self) -> View | None:
        """What the camera sees of the model at present; None before there is one."""


@dataclass(frozen=True)
class Scene:
    """Where a system works: the camera and the cube that is reconstructed.

    volume_size: side in metres. initial_position: the first camera centre as a fraction of the cube.
    """

    camera: Camera
    volume_size: float
    initial_position: tuple[float, float, float]
