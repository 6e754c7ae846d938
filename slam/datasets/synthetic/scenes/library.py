"""A reading room, held out: 2 to 4 m away, through a noisy and slightly distorted Kinect."""

from __future__ import annotations

from slam.datasets.synthetic import furniture as f
from slam.datasets.synthetic.kinect import Sensor
from slam.datasets.synthetic.scenes.scene import Layout, SyntheticScene, at
from slam.datasets.synthetic.waypoints import Waypoint, WaypointPath

LIBRARY = SyntheticScene(
    name="library",
    role="held-out",
    summary="a reading room from 2 to 4 m, 13 mm a frame; noisy, slightly distorted depth",
    shapes=Layout(
        (
            at(0, 0, 0, f.shell, width=4.8, depth=5.0, height=2.8, floor=f.CARPET),
            at(-1.3, 2.3, 0, f.shelf, width=1.3, height=2.2, rows=6, material=f.DARK_WOOD),
            at(0.15, 2.3, 0, f.shelf, width=1.3, height=2.2, rows=6, material=f.DARK_WOOD),
            at(1.6, 2.46, 0, f.window, width=1.1, height=1.5, bottom=0.8),
            at(-2.2, 0.9, -90, f.shelf, width=1.6, height=2.2, rows=6, material=f.DARK_WOOD),
            at(2.2, 0.6, 90, f.shelf, width=1.3, height=1.2, rows=3, material=f.DARK_WOOD),
            at(2.2, 0.6, 0, f.clutter, width=0.2, depth=1.0, count=6, bottom=1.2, largest=0.3),
            at(0.1, 0.9, 10, f.table, width=1.5, depth=0.9),
            at(0.1, 0.9, 10, f.clutter, width=1.2, depth=0.6, count=9, bottom=0.74, largest=0.3),
            at(0.35, 1.1, 0, f.lamp, bottom=0.74, height=0.55),
            at(-0.3, 0.2, 190, f.chair, seat=f.CLOTH),
            at(0.6, 0.15, 165, f.chair, seat=f.CLOTH),
            at(1.1, 1.0, 80, f.chair, seat=f.CLOTH),
            at(-1.25, 0.2, 140, f.office_chair),
            at(1.7, 1.9, 0, f.plant, height=1.4),
            at(-1.6, 1.6, 0, f.lamp, height=1.7),
            at(2.38, -1.2, 90, f.door),
        )
    ),
    poses=WaypointPath(
        lap=7.3,
        waypoints=(
            Waypoint((-0.90, 1.55, -1.70), (-0.40, 0.90, 1.40)),
            Waypoint((-0.45, 1.60, -1.60), (-0.10, 0.95, 1.60)),
            Waypoint((0.10, 1.50, -1.45), (0.50, 0.90, 1.50)),
            Waypoint((0.65, 1.60, -1.60), (0.90, 0.90, 1.30)),
            Waypoint((0.35, 1.65, -1.95), (0.20, 1.00, 1.40)),
            Waypoint((-0.40, 1.50, -2.00), (-0.70, 0.95, 1.30)),
        ),
        rush=0.3,
        roll=3.0,
    ),
    volume_size=5.6,
    initial_position=(0.45, 0.55, 0.1),
    sensor=Sensor(disparity_sigma=0.4, distortion=0.25, dropout=0.01, faintest=0.022),
)
