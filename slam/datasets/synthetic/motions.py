"""Motions that break trackers, in any scene: a fast rotation by hand, and a fast walk."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from slam.datasets.sequence import SequenceError
from slam.datasets.synthetic.camera_paths import STILL, since_start
from slam.datasets.synthetic.place import turn
from slam.datasets.synthetic.scenes.scene import SyntheticScene

Array = npt.NDArray[np.float64]
CameraPath = Callable[[Array, int], Array]  # poses (n, 4, 4) at seconds (n,), for a seed

ROTATION_SPEED = (1.0, 2.0)  # radians a second, of each turn of the hand
ROTATION_LIMITS = np.array([60.0, 30.0, 40.0])  # degrees of yaw, pitch and roll to either side
SHORTEST_TURN = 15.0  # degrees
PAUSE = (0.0, 0.15)  # seconds between two turns
EASED = np.linspace(-0.04, 0.04, 5)  # seconds in which a turn begins or ends
TRAVEL = 0.25  # of the scene's own speed: a hand that turns fast hardly travels

WALK_STEP = 0.145  # metres a frame: the key frames of a recording, or a camera that is carried at a run
SAMPLE_RATE = 480  # a second, of the scene's path


def with_motion(scene: SyntheticScene, motion: str) -> SyntheticScene:
    """`scene` with the camera motion called `motion`, one of MOTIONS; its name becomes `scene`-MOTION.

    Raises SequenceError for a loop, whose path has an end.
    """
    if scene.role == "loop":
        raise SequenceError(f"{scene.name} is a loop, whose camera path is fixed: choose another scene")
    return replace(scene, name=f"{scene.name}-{motion}", poses=MOTIONS[motion](scene.poses))


def fast_rotation(path: CameraPath) -> CameraPath:
    """`path` at a quarter of its speed, with a camera that a hand turns jerkily by ROTATION_SPEED.

    The hand turns to random angles about all three axes, stops for a moment, and turns on, as in the TUM
    benchmark's freiburg1_rpy.
    """

    def poses(timestamps: Array, seed: int) -> Array:
        rng = np.random.default_rng([seed, 5])
        seconds, angles = [0.0, STILL + EASED[-1]], [np.zeros(3), np.zeros(3)]
        while seconds[-1] < timestamps[-1] + EASED[-1]:
            target = rng.uniform(-ROTATION_LIMITS, ROTATION_LIMITS)
            distance = float(np.linalg.norm(target - angles[-1]))
            if distance < SHORTEST_TURN:
                continue
            arrival = seconds[-1] + np.radians(distance) / rng.uniform(*ROTATION_SPEED)
            seconds += [arrival, arrival + rng.uniform(*PAUSE)]
            angles += [target, target]
        eased = np.maximum(timestamps[:, None] + EASED, 0)
        turned = np.stack(
            [np.interp(eased, seconds, axis).mean(axis=1) for axis in np.array(angles).T], axis=1
        )
        result = path(timestamps * TRAVEL, seed)
        result[:, :3, :3] = result[:, :3, :3] @ np.array([turn(*row) for row in turned])
        return result

    return poses


def fast_walk(path: CameraPath) -> CameraPath:
    """`path`, travelled by WALK_STEP metres a frame once the camera is under way."""

    def poses(timestamps: Array, seed: int) -> Array:
        started = since_start(timestamps)[1]
        wanted = WALK_STEP * np.cumsum(np.minimum(2 * started, 1))
        seconds, travelled = timestamps[-1] + 1, np.zeros(1)
        while travelled[-1] < wanted[-1]:
            seconds *= 2
            samples = path(np.arange(0, seconds, 1 / SAMPLE_RATE), seed)
            steps = np.linalg.norm(np.diff(samples[:, :3, 3], axis=0), axis=1)
            travelled = np.concatenate([[0.0], np.cumsum(steps)])
        return samples[np.searchsorted(travelled, wanted)]

    return poses


MOTIONS: dict[str, Callable[[CameraPath], CameraPath]] = {
    "fast-rotation": fast_rotation,
    "fast-walk": fast_walk,
}
