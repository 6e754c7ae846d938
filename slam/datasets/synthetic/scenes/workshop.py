"""A cluttered workshop, held out: the fastest hand, which turns while it moves."""

from __future__ import annotations

from slam.datasets.synthetic import furniture as f
from slam.datasets.synthetic.kinect import Sensor
from slam.datasets.synthetic.scenes.scene import Layout, SyntheticScene, at
from slam.datasets.synthetic.waypoints import Waypoint, WaypointPath

WORKSHOP = SyntheticScene(
    name="workshop",
    role="held-out",
    summary="a cluttered workshop, 21 mm and 0.5 degrees a frame; open shelves, steel and rubber",
    shapes=Layout(
        (
            at(0, 0, 0, f.shell, width=4.4, depth=4.4, height=2.7, wall=f.BRICK, floor=f.TILES),
            at(0.2, 1.75, 0, f.table, width=2.0, depth=0.7, height=0.9, material=f.DARK_WOOD),
            at(0.2, 1.75, 0, f.clutter, width=1.8, depth=0.5, count=16, bottom=0.9, largest=0.3),
            at(0.2, 2.15, 0, f.shelf, width=1.8, height=2.1, depth=0.25, rows=5, back=False),
            at(-1.7, 1.7, -45, f.boxes, count=4, size=0.5),
            at(-1.95, 0.3, -90, f.shelf, width=1.6, height=1.9, depth=0.4, rows=4, material=f.STEEL),
            at(1.95, 0.6, 90, f.shelf, width=1.6, height=1.9, depth=0.4, rows=4, material=f.STEEL),
            at(-0.6, 0.6, 15, f.table, width=0.9, depth=0.6, height=0.6),
            at(-0.6, 0.6, 15, f.clutter, width=0.7, depth=0.4, count=7, bottom=0.6, largest=0.25),
            at(0.8, 0.9, 0, f.clutter, width=0.8, depth=0.6, count=7, largest=0.4),
            at(1.45, 1.9, 0, f.pillar, width=0.3, height=2.7),
            at(-1.3, -0.7, 0, f.clutter, width=0.8, depth=0.8, count=6, largest=0.5),
            at(1.5, -0.8, 0, f.clutter, width=0.8, depth=0.8, count=6, largest=0.5),
        )
    ),
    poses=WaypointPath(
        lap=5.2,
        waypoints=(
            Waypoint((-0.70, 1.50, -1.35), (-0.60, 0.85, 1.20)),
            Waypoint((-0.30, 1.60, -1.00), (0.30, 0.90, 1.60)),
            Waypoint((0.35, 1.40, -0.80), (1.20, 0.85, 1.40)),
            Waypoint((0.75, 1.45, -1.20), (0.70, 0.90, 1.50)),
            Waypoint((0.30, 1.60, -1.55), (-0.30, 0.85, 1.30)),
            Waypoint((-0.35, 1.45, -1.75), (-1.10, 0.80, 0.90)),
        ),
        rush=0.2,
        tremor=1.5,
    ),
    volume_size=5.2,
    initial_position=(0.4, 0.55, 0.12),
    sensor=Sensor(disparity_sigma=0.3, faintest=0.035),
)
