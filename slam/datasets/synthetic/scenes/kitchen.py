"""A narrow kitchen passed by fast: a dark oven and steel that are not measured from everywhere."""

from __future__ import annotations

from slam.datasets.synthetic import furniture as f
from slam.datasets.synthetic.kinect import Sensor
from slam.datasets.synthetic.scenes.scene import Layout, SyntheticScene, at
from slam.datasets.synthetic.waypoints import Waypoint, WaypointPath

KITCHEN = SyntheticScene(
    name="kitchen",
    role="learned-on",
    summary="a narrow kitchen passed by fast: 18 mm a frame; dark oven, steel, 1 to 3 m",
    shapes=Layout(
        (
            at(0, 0, 0, f.shell, width=2.7, depth=4.0, height=2.5, floor=f.TILES),
            at(-1.05, -0.95, -90, f.cupboard, width=1.2, depth=0.58, top=f.DARK_WOOD),
            at(-1.05, -0.05, -90, f.oven),
            at(-1.05, 0.75, -90, f.cupboard, width=1.0, depth=0.58, top=f.DARK_WOOD),
            at(-1.17, -0.95, -90, f.cupboard, width=1.2, height=0.7, depth=0.34, bottom=1.45),
            at(-1.17, 0.75, -90, f.cupboard, width=1.0, height=0.7, depth=0.34, bottom=1.45),
            at(
                -1.1,
                -0.05,
                -90,
                f.cupboard,
                width=0.6,
                height=0.3,
                depth=0.5,
                doors=1,
                bottom=1.6,
                material=f.STEEL,
            ),
            at(-1.0, 1.65, -90, f.cupboard, width=0.65, height=1.85, depth=0.62, doors=1),
            at(-1.05, -0.95, 0, f.clutter, width=0.35, depth=0.9, count=8, bottom=0.94, largest=0.22),
            at(-1.05, 0.75, 0, f.clutter, width=0.35, depth=0.7, count=6, bottom=0.94, largest=0.25),
            at(0.1, 1.98, 0, f.window, width=1.0, height=1.1, bottom=1.0),
            at(0.95, 1.5, 20, f.table, width=0.7, depth=0.7),
            at(0.95, 1.5, 0, f.clutter, width=0.4, depth=0.4, count=5, bottom=0.74, largest=0.2),
            at(0.3, 1.3, 75, f.chair),
            at(1.1, 0.75, 170, f.chair),
        )
    ),
    poses=WaypointPath(
        lap=6.3,
        waypoints=(
            Waypoint((0.65, 1.45, -1.25), (-0.9, 1.05, -0.30)),
            Waypoint((0.75, 1.50, -0.70), (-0.9, 1.10, 0.25)),
            Waypoint((0.65, 1.40, 0.00), (-0.9, 0.95, 0.95)),
            Waypoint((0.55, 1.55, 0.35), (-0.6, 1.00, 1.55)),
            Waypoint((0.75, 1.35, -0.10), (-0.8, 0.90, 1.10)),
            Waypoint((0.70, 1.50, -0.80), (-0.9, 1.00, 0.35)),
        ),
        rush=0.25,
    ),
    volume_size=4.2,
    initial_position=(0.35, 0.53, 0.1),
    sensor=Sensor(disparity_sigma=0.3, faintest=0.035),
)
