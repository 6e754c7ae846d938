"""Small images that kernels are tried on."""

from __future__ import annotations

import numpy as np

from slam.camera import Camera

CAMERA = Camera(30.0, 31.0, 19.3, 14.6, 40, 30)
MIRRORED = Camera(30.0, -31.0, 19.3, 14.6, 40, 30)


def planes(image: np.ndarray) -> list[np.ndarray]:
    return [np.ascontiguousarray(image[..., axis], np.float32) for axis in range(3)]


def image(camera: Camera) -> tuple[str, int, int]:
    """The size of a kernel over an image of this camera."""
    return ("image", camera.width, camera.height)


def room_depth(camera: Camera, seed: int = 0) -> np.ndarray:
    """A wavy wall with a box in front of it and holes, in metres."""
    random = np.random.default_rng(seed)
    y, x = np.mgrid[: camera.height, : camera.width]
    depth = 1.5 + 0.1 * np.sin(x / 4.0) + 0.05 * np.cos(y / 3.0)
    depth[8:20, 10:24] = 1.05 + 0.01 * x[8:20, 10:24]
    depth += random.normal(0, 0.002, depth.shape)
    depth[random.random(depth.shape) < 0.05] = 0
    return depth.astype(np.float32)
