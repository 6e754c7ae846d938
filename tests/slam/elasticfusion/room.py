"""A painted room with balls in it, seen by a small camera: a few dozen frames, made in a moment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slam.camera import Camera
from tests.slam.numpy_kernels.dense import exponential

CAMERA = Camera(120.0, 120.0, 79.5, 59.5, 160, 120)
WALLS = np.array([[-1.9, -1.2, -1.7], [1.6, 1.1, 2.0]])
BALLS = (
    ((-0.6, 0.3, 1.5), 0.45),
    ((0.6, -0.3, 1.6), 0.4),
    ((1.1, 0.35, 0.5), 0.4),
    ((1.2, -0.4, -0.3), 0.35),
    ((0.1, 0.3, -1.2), 0.3),
    ((-1.3, 0.1, -0.6), 0.4),
    ((-1.3, -0.2, 0.6), 0.35),
)
WAVES = np.array([[23, 5, -9], [-7, 19, 11], [10, -8, 21], [5, 11, 3], [-3, 4, 9], [41, 29, -33]]) / 2.0


@dataclass(frozen=True)
class Recording:
    """Frames and the true poses they were taken from, relative to the first."""

    depth: list[np.ndarray]
    colour: list[np.ndarray]
    truth: np.ndarray

    def __len__(self) -> int:
        return len(self.depth)

    def dark(self, first: int, last: int) -> Recording:
        """The same with nothing to see in the frames from `first` to `last`."""
        hidden = range(first, last + 1)
        depth = [np.zeros_like(image) if i in hidden else image for i, image in enumerate(self.depth)]
        colour = [np.zeros_like(image) if i in hidden else image for i, image in enumerate(self.colour)]
        return Recording(depth, colour, self.truth)


def there_and_back(frames: int, degrees: float) -> np.ndarray:
    """Poses of a camera that turns so far to the right, with a small arc, and comes back the same way."""
    half = frames // 2
    angles = (
        np.radians(degrees) * np.minimum(np.arange(frames), frames - 1 - np.arange(frames)) / (half - 0.5)
    )
    return np.array([turned(angle) for angle in angles])


def turned(angle: float) -> np.ndarray:
    pose = exponential(np.array([0, 0, 0, 0.05 * np.sin(3 * angle), angle, 0]))
    pose[:3, 3] = 0.25 * np.sin(angle), 0.05 * np.sin(2 * angle), 0.25 * np.cos(angle)
    return pose


def sideways(frames: int, step: float) -> np.ndarray:
    """Poses of a camera that moves `step` metres a frame to the right, facing z."""
    poses = np.tile(np.eye(4), (frames, 1, 1))
    poses[:, 0, 3] = step * np.arange(frames)
    return poses


def record(
    poses: np.ndarray, wall_only: bool = False, light: np.ndarray | None = None, smooth: bool = False
) -> Recording:
    """What the camera sees from `poses` of the room, or of a flat painted wall alone 1.5 m ahead.

    light: what each frame's brightness is multiplied by. smooth: paint without any edge.
    """
    light = np.ones(len(poses)) if light is None else light
    views = [
        _view(pose, wall_only, brightness, smooth) for pose, brightness in zip(poses, light, strict=True)
    ]
    return Recording([v[0] for v in views], [v[1] for v in views], np.linalg.inv(poses[0]) @ poses)


def _view(
    pose: np.ndarray, wall_only: bool, brightness: float, smooth: bool
) -> tuple[np.ndarray, np.ndarray]:
    y, x = np.mgrid[: CAMERA.height, : CAMERA.width]
    rays = np.dstack([(x - CAMERA.cx) / CAMERA.fx, (y - CAMERA.cy) / CAMERA.fy, np.ones(x.shape)])
    directions, origin = rays @ pose[:3, :3].T, pose[:3, 3]
    if wall_only:
        depth = (1.5 - origin[2]) / directions[..., 2]
    else:
        with np.errstate(divide="ignore"):
            depth = np.where(directions > 0, WALLS[1] - origin, WALLS[0] - origin) / directions
        depth = depth.min(axis=-1)
        for centre, radius in BALLS:
            offset = origin - centre
            a, b = np.sum(directions**2, axis=-1), directions @ offset
            discriminant = b**2 - a * (offset @ offset - radius**2)
            hit = (-b - np.sqrt(np.maximum(discriminant, 0))) / a
            depth = np.where((discriminant > 0) & (hit > 0), np.minimum(depth, hit), depth)
    points = origin + depth[..., None] * directions
    waves = np.sin(points @ WAVES.T)
    mixed = np.dstack([waves.sum(axis=-1), waves[..., ::2].sum(axis=-1), waves[..., 1::2].sum(axis=-1)])
    paint = 128 + (7 * mixed if smooth else 90 * np.tanh(mixed))
    colour = np.clip(np.rint(brightness * paint), 1, 255).astype(np.uint8)
    return np.rint(1000 * depth).astype(np.uint16), colour
