"""A desk from close by: a slow camera, 0.5 to 1.5 m from things with many edges and a dark screen."""

from __future__ import annotations

from slam.datasets.synthetic import furniture as f
from slam.datasets.synthetic.kinect import Sensor
from slam.datasets.synthetic.scenes.scene import Layout, SyntheticScene, at
from slam.datasets.synthetic.waypoints import Waypoint, WaypointPath

DESK = SyntheticScene(
    name="desk",
    role="learned-on",
    summary="a desk from 0.5 to 1.5 m, slow: 5 mm a frame; small things, a dark screen",
    shapes=Layout(
        (
            at(0, 0, 0, f.shell, width=3.2, depth=2.8, height=2.5),
            at(0, 1.0, 0, f.table, width=1.7, depth=0.8),
            at(-0.15, 1.15, 8, f.monitor),
            at(0.62, 1.15, -20, f.lamp, bottom=0.74, height=0.5),
            at(-0.68, 1.2, 0, f.plant, bottom=0.74, height=0.45),
            at(0.4, 0.9, 0, f.clutter, width=0.6, depth=0.45, count=9, bottom=0.74, largest=0.16),
            at(-0.55, 0.85, 0, f.clutter, width=0.4, depth=0.3, count=6, bottom=0.74, largest=0.14),
            at(0, 1.39, 0, f.picture, width=0.7, bottom=1.5),
            at(-0.8, 1.39, 0, f.picture, width=0.35, bottom=1.4),
            at(1.35, 0.9, 60, f.shelf, width=0.8, height=1.8),
            at(-1.2, 0.3, -70, f.boxes),
            at(0.45, 0.35, 200, f.office_chair),
        )
    ),
    poses=WaypointPath(
        lap=9.0,
        waypoints=(
            Waypoint((-0.25, 1.20, 0.15), (-0.15, 0.80, 1.10)),
            Waypoint((0.15, 1.35, 0.10), (0.20, 0.75, 1.05)),
            Waypoint((0.30, 1.15, 0.25), (0.35, 0.85, 1.15)),
            Waypoint((-0.05, 1.05, 0.30), (-0.30, 0.90, 1.15)),
        ),
    ),
    volume_size=2.7,
    initial_position=(0.4, 0.46, 0.1),
    sensor=Sensor(faintest=0.035),
)
