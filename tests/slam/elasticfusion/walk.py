"""A walk round a patterned room, as thumbnails: what ferns and loop closing are tested on."""

from __future__ import annotations

import numpy as np

from slam.camera import Camera
from slam.elasticfusion.loops.thumbnail import Thumbnail
from tests.slam.numpy_kernels.dense import exponential

CAMERA = Camera(60.0, 60.0, 39.5, 29.5, 80, 60)
ROOM = np.array([2.6, 1.4, 2.2])  # half its sides


def pose(angle: float) -> np.ndarray:
    """On a small circle in the middle of the room, looking outwards."""
    result = exponential(np.array([0, 0, 0, 0, angle, 0]))
    result[:3, 3] = 0.5 * np.sin(angle), 0.1 * np.sin(3 * angle), 0.5 * np.cos(angle)
    return result


def view(camera_pose: np.ndarray, noise: int | None = None) -> Thumbnail:
    """What is seen from there; `noise` seeds what a sensor adds to depth and colour."""
    y, x = np.mgrid[: CAMERA.height, : CAMERA.width]
    rays = np.dstack([(x - CAMERA.cx) / CAMERA.fx, (y - CAMERA.cy) / CAMERA.fy, np.ones(x.shape)])
    directions, origin = rays @ camera_pose[:3, :3].T, camera_pose[:3, 3]
    walls = np.where(directions > 0, ROOM - origin, -ROOM - origin) / directions
    depth = walls.min(axis=-1)
    points = origin + depth[..., None] * directions
    pattern = np.sin(points @ np.array([[2.1, 0.7, 1.3], [0.4, 3.1, -0.9], [1.7, -1.1, 2.3]]).T)
    colours = 128 + 100 * pattern
    normals = np.zeros_like(points)
    np.put_along_axis(normals, walls.argmin(axis=-1)[..., None], 1.0, axis=-1)
    normals *= -np.sign(directions)
    if noise is not None:
        random = np.random.default_rng(noise)
        depth = depth + random.normal(0, 0.01, depth.shape)
        depth[random.random(depth.shape) < 0.1] = 0
        colours = colours + random.normal(0, 4, colours.shape)
    r, g, b = np.moveaxis(np.clip(np.rint(colours), 1, 255).astype(np.uint32), -1, 0)
    turned = (normals @ camera_pose[:3, :3]).astype(np.float32)
    return Thumbnail(CAMERA, depth.astype(np.float32), turned, r | g << 8 | b << 16)
