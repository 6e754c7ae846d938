"""A studio with a table in the middle: the camera walks once round it and on, with colour on all walls."""

from __future__ import annotations

import math

from slam.datasets.synthetic import furniture as f
from slam.datasets.synthetic.kinect import Sensor
from slam.datasets.synthetic.scenes.scene import Layout, SyntheticScene, at
from slam.datasets.synthetic.waypoints import Waypoint, WaypointPath

STOPS = 8
RADIUS = 1.15  # metres from the middle of the table


def _waypoint(number: int) -> Waypoint:
    """On the circle, looking past the middle of the table at its far side."""
    angle = 2 * math.pi * number / STOPS
    x, z = RADIUS * math.sin(angle), -RADIUS * math.cos(angle)
    return Waypoint((x, 1.5 + 0.06 * (number % 2), z), (-0.4 * x, 0.75, -0.4 * z))


STUDIO = SyntheticScene(
    name="studio-loop",
    role="loop",
    summary="a studio, once round its table and on: 18 mm a frame, colour on all walls",
    shapes=Layout(
        (
            at(0, 0, 0, f.shell, width=4.4, depth=4.4, height=2.6, wall=f.WALLPAPER),
            at(0, 0, 20, f.table, width=1.1, depth=0.8),
            at(0, 0, 20, f.clutter, width=0.9, depth=0.6, count=14, bottom=0.74, largest=0.28),
            at(-0.9, 1.9, 0, f.shelf),
            at(0.8, 1.9, 0, f.cupboard, width=1.3),
            at(0.8, 1.9, 0, f.clutter, width=1.1, depth=0.3, count=7, bottom=0.9, largest=0.35),
            at(0.8, 2.18, 0, f.picture, width=0.9, height=0.6, bottom=1.5),
            at(1.9, 0.4, 90, f.cupboard, width=1.4, height=0.7, material=f.WOOD),
            at(1.9, 0.4, 0, f.clutter, width=0.3, depth=1.1, count=7, bottom=0.7, largest=0.35),
            at(1.8, -1.5, 0, f.plant, height=1.4),
            at(0.5, -1.95, 180, f.shelf, height=1.3, rows=3, material=f.DARK_WOOD),
            at(-0.8, -2.07, 180, f.door),
            at(-1.8, -1.5, 0, f.boxes, count=3, size=0.5),
            at(-1.95, 0.2, -90, f.shelf, width=1.4, height=1.1, rows=2),
            at(-2.18, 0.2, -90, f.picture, width=1.0, height=0.7, bottom=1.4, material=f.BRICK),
            at(-1.8, 1.5, 0, f.lamp),
            at(2.18, -0.7, 90, f.picture, width=0.6, height=0.8, bottom=1.2),
        )
    ),
    poses=WaypointPath(lap=13.0, waypoints=tuple(_waypoint(number) for number in range(STOPS))),
    volume_size=5.4,
    initial_position=(0.5, 0.47, 0.25),
    sensor=Sensor(faintest=0.03),
    frames=440,
)
