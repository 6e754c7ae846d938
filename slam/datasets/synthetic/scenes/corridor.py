"""A corridor walked along fast: the camera moves forwards, and much of what it sees is walls and floor."""

from __future__ import annotations

from slam.datasets.synthetic import furniture as f
from slam.datasets.synthetic.kinect import Sensor
from slam.datasets.synthetic.scenes.scene import Layout, SyntheticScene, at
from slam.datasets.synthetic.waypoints import Waypoint, WaypointPath

CORRIDOR = SyntheticScene(
    name="corridor",
    role="learned-on",
    summary="a corridor walked along: 20 mm a frame forwards; slanted walls, far ends, black coats",
    shapes=Layout(
        (
            at(0, 0, 0, f.shell, width=2.1, depth=5.4, height=2.5),
            at(-1.03, -1.6, -90, f.door),
            at(1.03, -0.6, 90, f.door),
            at(-1.03, 1.3, -90, f.door),
            at(-0.85, -0.3, -90, f.cupboard, width=1.0, height=0.8, depth=0.36, material=f.DARK_WOOD),
            at(-0.85, -0.3, 0, f.clutter, width=0.2, depth=0.8, count=5, bottom=0.8, largest=0.25),
            at(1.0, 0.6, 90, f.coats),
            at(0.85, 0.6, 90, f.shelf, width=1.0, height=0.5, depth=0.3, rows=1),
            at(-0.85, 2.3, -90, f.shelf, width=0.7, height=1.9),
            at(0.2, 2.66, 0, f.window, width=0.8),
            at(0.8, 2.2, 0, f.plant, height=1.2),
            at(0.1, 1.9, 30, f.chair),
            at(-1.03, 0.45, -90, f.picture),
            at(1.03, -1.6, 90, f.picture, width=0.8, height=0.6, bottom=1.25),
            at(1.03, 1.6, 90, f.picture, width=0.5, height=0.7),
            at(0.75, -0.1, 0, f.boxes, count=2, size=0.35),
            at(-0.1, 0.9, 0, f.clutter, width=1.3, depth=1.6, count=5, largest=0.25),
            at(0, 0.3, 0, f.beam, length=2.1, bottom=2.36),
            at(0, 1.9, 0, f.beam, length=2.1, bottom=2.36),
        )
    ),
    poses=WaypointPath(
        lap=7.1,
        waypoints=(
            Waypoint((-0.10, 1.50, -2.10), (-0.20, 0.90, 0.60)),
            Waypoint((0.10, 1.45, -1.50), (0.30, 0.90, 1.20)),
            Waypoint((0.15, 1.50, -0.80), (0.10, 0.90, 1.80)),
            Waypoint((0.00, 1.45, -0.10), (-0.40, 0.90, 2.00)),
            Waypoint((-0.15, 1.50, 0.00), (0.20, 0.95, 2.20)),
            Waypoint((-0.15, 1.45, -0.70), (0.40, 0.90, 1.60)),
            Waypoint((-0.10, 1.50, -1.50), (0.00, 0.85, 1.00)),
        ),
        tremor=1.5,
    ),
    volume_size=5.6,
    initial_position=(0.46, 0.55, 0.06),
    sensor=Sensor(disparity_sigma=0.3, faintest=0.022),
)
