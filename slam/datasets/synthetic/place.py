"""A place in a room, and what is put there.

World axes are OpenCV's: x right, y down, z forward, metres; the floor is y = 0, the middle of a room is
x = z = 0. Furniture is described as people would: a place on the floor, a height above it, and a size.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from slam.datasets.synthetic.shapes import Kind, Pattern, Shape

Array = npt.NDArray[np.float64]
Colour = tuple[int, int, int]
Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Material:
    """The look of a surface, and the share of the Kinect's infrared light that it sends back (`albedo`,
    0 to 1). Black plastic sends back little, so it is not measured from afar or aslant; glass and screens
    send back nothing (0)."""

    colour: Colour
    pattern: Pattern = "plain"
    albedo: float = 0.7


def turn(yaw: float = 0.0, pitch: float = 0.0, roll: float = 0.0) -> Array:
    """Rotation (3, 3) by degrees: roll about z, then pitch about x (positive looks up), then yaw about y."""
    a, b, c = np.radians([yaw, pitch, roll])
    Ry = np.array([[math.cos(a), 0, math.sin(a)], [0, 1, 0], [-math.sin(a), 0, math.cos(a)]])
    Rx = np.array([[1, 0, 0], [0, math.cos(b), -math.sin(b)], [0, math.sin(b), math.cos(b)]])
    Rz = np.array([[math.cos(c), -math.sin(c), 0], [math.sin(c), math.cos(c), 0], [0, 0, 1]])
    rotation: Array = Ry @ Rx @ Rz
    return rotation


class Place:
    """A spot on the floor and a direction to face; what is put there keeps to its axes."""

    def __init__(self, shapes: list[Shape], x: float = 0.0, z: float = 0.0, yaw: float = 0.0) -> None:
        self._shapes = shapes
        self._origin = np.array([x, 0.0, z])
        self._rotation = turn(yaw)

    def put(
        self,
        kind: Kind,
        at: Vector,
        size: Vector,
        colour: Colour,
        pattern: Pattern = "plain",
        tilt: Array | None = None,
        top: float = 1.0,
        edge: float = 0.0,
        mirror: bool = False,
        albedo: float = 1.0,
    ) -> None:
        """Add a shape whose underside lies at the height `at[1]` above the floor, before any tilt.

        `at` is (x, height, z) from this place, `size` (width, height, depth).
        """
        x, height, z = at
        centre = self._origin + self._rotation @ np.array([x, -(height + size[1] / 2), z])
        rotation = self._rotation if tilt is None else self._rotation @ tilt
        half = np.array(size) / 2
        self._shapes.append(Shape(kind, centre, half, rotation, top, edge, colour, pattern, mirror, albedo))

    def add(
        self,
        kind: Kind,
        at: Vector,
        size: Vector,
        material: Material,
        tilt: Vector = (0.0, 0.0, 0.0),
        top: float = 1.0,
        edge: float = 0.0,
    ) -> None:
        """Add a shape of a material, as `put` does; `tilt` is yaw, pitch and roll in degrees."""
        self.put(
            kind, at, size, material.colour, material.pattern, turn(*tilt), top, edge,
            mirror=material.albedo == 0, albedo=material.albedo,
        )  # fmt: skip

    def at(self, x: float, z: float, yaw: float = 0.0) -> Place:
        """A place that lies `x`, `z` metres from this one and is turned by `yaw` degrees against it."""
        place = Place(self._shapes)
        place._origin = self._origin + self._rotation @ np.array([x, 0.0, z])
        place._rotation = self._rotation @ turn(yaw)
        return place
