"""A camera path through waypoints: where the camera is, and what it looks at."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from slam.datasets.synthetic.camera_paths import (
    TREMOR_ANGLE,
    TREMOR_POSITION,
    get_tremor,
    since_start,
    to_poses,
)
from slam.datasets.synthetic.place import Vector

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Waypoint:
    """The camera's position and the point that it looks at, both as (x, height, z), metres."""

    position: Vector
    target: Vector


@dataclass(frozen=True)
class WaypointPath:
    """A closed path: from waypoint to waypoint in equal times, and after `lap` seconds at the first again.

    Calling it returns poses (n, 4, 4) at some seconds, camera to world. The camera holds still for four
    frames and then gathers speed. `rush` (0 to 1) lets the speed rise and fall by that fraction,
    `rush_hertz` times a second; `tremor` scales the tremor of the hand; `roll` (degrees) tilts the camera
    once a lap to either side.
    """

    lap: float
    waypoints: tuple[Waypoint, ...]
    rush: float = 0.0
    rush_hertz: float = 0.8
    tremor: float = 1.0
    roll: float = 0.0

    def __call__(self, timestamps: Array, seed: int) -> Array:
        seconds, started = since_start(timestamps)
        pace = started * (1 + self.rush * np.sin(2 * math.pi * self.rush_hertz * seconds))
        steps = np.diff(timestamps, prepend=timestamps[0])
        progress = np.cumsum(pace * steps) / self.lap
        tremor = self.tremor * started[:, None] * get_tremor(seconds, seed)
        position = catmull_rom(_points([w.position for w in self.waypoints]), progress)
        gaze = catmull_rom(_points([w.target for w in self.waypoints]), progress) - position
        yaw = np.degrees(np.arctan2(gaze[:, 0], gaze[:, 2]))
        pitch = np.degrees(np.arctan2(-gaze[:, 1], np.hypot(gaze[:, 0], gaze[:, 2])))
        roll = self.roll * np.sin(2 * math.pi * progress)
        angles = np.stack([yaw, pitch, roll], axis=1) + TREMOR_ANGLE * tremor[:, 3:]
        return to_poses(position + TREMOR_POSITION * tremor[:, :3], angles)


def catmull_rom(points: Array, progress: Array) -> Array:
    """The closed uniform Catmull-Rom spline through `points` (k, 3) at `progress` (n,), in laps: (n, 3).

    At progress i / k it passes through point i. Catmull and Rom 1974, with tension 1/2.
    """
    position = (progress % 1.0) * len(points)
    index = np.floor(position).astype(np.intp) % len(points)
    t = (position - np.floor(position))[:, None]
    before, start, end, after = (points[(index + offset) % len(points)] for offset in (-1, 0, 1, 2))
    return np.asarray(
        start
        + 0.5 * t * (end - before)
        + t**2 * (before - 2.5 * start + 2 * end - 0.5 * after)
        + t**3 * (1.5 * (start - end) + 0.5 * (after - before))
    )


def _points(places: list[Vector]) -> Array:
    """World points (k, 3), y down, of (x, height, z)."""
    return np.array(places) * [1.0, -1.0, 1.0]
