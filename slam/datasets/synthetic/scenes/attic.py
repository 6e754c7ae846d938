"""An attic bedroom through a poor Kinect: noisy depth with a smooth distortion, and a hurried hand."""

from __future__ import annotations

from slam.datasets.synthetic import furniture as f
from slam.datasets.synthetic.kinect import Sensor
from slam.datasets.synthetic.scenes.scene import Layout, SyntheticScene, at
from slam.datasets.synthetic.waypoints import Waypoint, WaypointPath

ATTIC = SyntheticScene(
    name="attic",
    role="learned-on",
    summary="an attic bedroom, noisy and distorted depth; a hand that hurries, 11 mm a frame",
    shapes=Layout(
        (
            at(0, 0, 0, f.shell, width=4.0, depth=4.2, height=2.6, wall=f.PLASTER, floor=f.DARK_WOOD),
            at(-1.45, 0, -90, f.slope, width=4.2, length=2.2, bottom=1.85, angle=45),
            at(1.45, 0, 90, f.slope, width=4.2, length=2.2, bottom=1.85, angle=45),
            at(0, 0.5, 0, f.beam, length=3.2, bottom=2.1),
            at(0, 1.8, 0, f.beam, length=3.2, bottom=2.1),
            at(-0.4, 1.0, 0, f.bed),
            at(0.75, 1.75, 0, f.cupboard, width=0.45, height=0.55, depth=0.4, doors=1, material=f.WOOD),
            at(0.75, 1.75, 0, f.lamp, bottom=0.55, height=0.45),
            at(1.4, 1.0, 70, f.cupboard, width=1.1, height=0.85, material=f.BLACK),
            at(1.4, 1.0, 0, f.clutter, width=0.3, depth=0.8, count=6, bottom=0.85, largest=0.2),
            at(-1.5, 1.7, -40, f.boxes, count=2),
            at(-1.55, 0.6, -90, f.shelf, width=1.0, height=0.8, rows=2),
            at(0.9, 0.2, -140, f.chair),
            at(0.9, 0.2, 0, f.clutter, width=0.2, depth=0.2, count=3, bottom=0.48, largest=0.25),
            at(1.35, -0.2, 0, f.plant, height=0.9),
            at(0.0, 2.09, 0, f.window, width=0.8, height=0.8, bottom=1.2),
            at(-0.9, -0.3, 0, f.clutter, width=1.0, depth=0.8, count=5, largest=0.3),
        )
    ),
    poses=WaypointPath(
        lap=5.6,
        waypoints=(
            Waypoint((0.20, 1.50, -1.30), (-0.20, 0.70, 1.20)),
            Waypoint((-0.15, 1.40, -1.05), (-0.50, 0.75, 1.20)),
            Waypoint((-0.30, 1.55, -0.70), (0.10, 0.70, 1.40)),
            Waypoint((0.10, 1.45, -0.55), (0.70, 0.75, 1.20)),
            Waypoint((0.40, 1.55, -0.90), (0.50, 0.80, 1.10)),
        ),
        rush=0.6,
        rush_hertz=0.9,
        roll=4.0,
    ),
    volume_size=4.8,
    initial_position=(0.48, 0.55, 0.1),
    sensor=Sensor(disparity_sigma=0.5, distortion=0.4, edge_dropout=0.6, dropout=0.02, faintest=0.04),
)
