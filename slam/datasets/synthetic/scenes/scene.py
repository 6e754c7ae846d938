"""A synthetic scene as data: its furniture, its camera path, and its depth sensor."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from slam.datasets.synthetic.kinect import KINECT, Sensor
from slam.datasets.synthetic.place import Place, Vector
from slam.datasets.synthetic.shapes import Shape

Array = npt.NDArray[np.float64]
# What a scene is for: searches learn on it, a found front is checked on it, or it closes a loop.
Role = Literal["learned-on", "held-out", "loop"]
Furniture = Callable[[Place, np.random.Generator], None]


@dataclass(frozen=True)
class SyntheticScene:
    """`shapes(seed)` are the room, `poses(timestamps, seed)` (n, 4, 4) the path, camera to world, metres.

    `volume_size` (m) and `initial_position` (fractions of it) place a cube, in the axes of the first camera,
    around all that the path sees. `frames` is the usual length.
    """

    name: str
    role: Role
    summary: str
    shapes: Callable[[int], list[Shape]]
    poses: Callable[[Array, int], Array]
    volume_size: float
    initial_position: Vector
    sensor: Sensor = KINECT
    frames: int = 100


@dataclass(frozen=True)
class Piece:
    """A piece of furniture at `x`, `z` in the room, metres, turned by `yaw` degrees."""

    furniture: Furniture
    x: float
    z: float
    yaw: float


def at(x: float, z: float, yaw: float, furniture: Callable[..., None], **options: Any) -> Piece:
    """Place `furniture` with its options; at yaw 0 its front looks towards -z."""
    return Piece(partial(furniture, **options), x, z, yaw)


@dataclass(frozen=True)
class Layout:
    """The pieces of a room. The seed chooses what is loose: books, leaves, things on tables."""

    pieces: tuple[Piece, ...]

    def __call__(self, seed: int) -> list[Shape]:
        rng = np.random.default_rng([seed, 1])
        shapes: list[Shape] = []
        for piece in self.pieces:
            piece.furniture(Place(shapes, piece.x, piece.z, piece.yaw), rng)
        return shapes
