"""An office in which the camera turns on the spot: quick rotation, little translation, always new things."""

from __future__ import annotations

from slam.datasets.synthetic import furniture as f
from slam.datasets.synthetic.kinect import Sensor
from slam.datasets.synthetic.scenes.scene import Layout, SyntheticScene, at
from slam.datasets.synthetic.waypoints import Waypoint, WaypointPath

OFFICE = SyntheticScene(
    name="office",
    role="learned-on",
    summary="an office turned round in: 1.3 degrees a frame; dark chairs and screens, 1.5 to 3 m",
    shapes=Layout(
        (
            at(0, 0, 0, f.shell, width=4.4, depth=4.2, height=2.6, floor=f.CARPET),
            at(-0.6, 1.65, 0, f.table, width=1.6, depth=0.8),
            at(-0.4, 1.8, -10, f.monitor),
            at(-1.0, 1.65, 0, f.clutter, width=0.5, depth=0.4, count=6, bottom=0.74, largest=0.22),
            at(-0.5, 0.95, 195, f.office_chair),
            at(0.75, 1.92, 0, f.shelf, width=0.9, rows=5),
            at(1.75, 0.9, 90, f.table, width=1.6, depth=0.8),
            at(1.9, 1.1, 95, f.monitor),
            at(1.75, 0.5, 0, f.clutter, width=0.4, depth=0.5, count=7, bottom=0.74, largest=0.25),
            at(1.15, 0.7, -80, f.office_chair),
            at(2.18, 0.9, 90, f.picture, width=1.2, height=0.8, bottom=1.3),
            at(1.95, -0.75, 90, f.cupboard, width=1.2, height=1.3, material=f.STEEL),
            at(1.95, -0.75, 0, f.clutter, width=0.3, depth=0.9, count=5, bottom=1.3, largest=0.3),
            at(1.1, -2.08, 180, f.window, width=1.3),
            at(-0.1, -1.8, 180, f.shelf, width=1.0, height=1.5, rows=4, material=f.DARK_WOOD),
            at(-1.5, -2.07, 180, f.door),
            at(-1.7, -0.9, 0, f.plant, height=1.3),
            at(-2.0, 0.2, -90, f.cupboard, width=1.4, height=0.75, depth=0.4, material=f.WOOD),
            at(-2.0, 0.2, 0, f.clutter, width=0.25, depth=1.2, count=8, bottom=0.75, largest=0.3),
            at(-2.18, 0.2, -90, f.picture, width=0.9, height=0.6, bottom=1.45),
            at(-1.9, 1.5, -60, f.boxes, count=4),
            at(0.9, -1.0, 30, f.boxes, count=2, size=0.45),
        )
    ),
    poses=WaypointPath(
        lap=9.0,
        waypoints=(
            Waypoint((0.00, 1.50, -0.25), (-0.2, 1.0, 2.0)),
            Waypoint((0.15, 1.45, -0.15), (1.4, 1.0, 1.4)),
            Waypoint((0.15, 1.50, 0.05), (2.0, 0.9, 0.0)),
            Waypoint((0.10, 1.55, 0.15), (1.4, 0.9, -1.4)),
            Waypoint((-0.05, 1.50, 0.15), (0.0, 0.9, -2.0)),
            Waypoint((-0.20, 1.45, 0.10), (-1.4, 0.9, -1.4)),
            Waypoint((-0.20, 1.50, -0.05), (-2.0, 1.0, 0.0)),
            Waypoint((-0.10, 1.55, -0.20), (-1.4, 1.0, 1.4)),
        ),
    ),
    volume_size=5.2,
    initial_position=(0.43, 0.44, 0.44),
    sensor=Sensor(faintest=0.035),
)
