"""A painted relief seen from anywhere: RGB-D images whose poses are known exactly."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from slam.camera import Camera
from slam.dense.images import cameras_of
from slam.devices.opencl import Session
from slam.elasticfusion.images import RgbdImage
from tests.slam.dense.scenes import planes
from tests.slam.numpy_kernels import odometry as reference
from tests.slam.numpy_kernels.dense import exponential, half_sample, normal_map, vertex_map

CAMERA = Camera(80.0, 81.0, 39.3, 30.4, 80, 60)


@dataclass(frozen=True)
class Seen:
    """depth (h, w) in metres, normals (h, w, 3), colour uint32 (h, w)."""

    camera: Camera
    depth: np.ndarray
    normals: np.ndarray
    colour: np.ndarray


def look(
    pose: np.ndarray,
    camera: Camera = CAMERA,
    relief: float = 0.15,
    contrast: float = 90,
    holes: int | None = None,
) -> Seen:
    """The relief from a camera at `pose`; waves of `relief` metres about 2 m away, painted with `contrast`.

    A seed for `holes` takes the depth from one pixel in twenty and the colour from others.
    """
    return _look(pose.tobytes(), camera, relief, contrast, holes)


@functools.cache
def _look(matrix: bytes, camera: Camera, relief: float, contrast: float, holes: int | None) -> Seen:
    pose = np.frombuffer(matrix).reshape(4, 4)
    rays = vertex_map(np.ones((camera.height, camera.width)), camera) @ pose[:3, :3].T
    depth = np.full(rays.shape[:2], 2.0)
    for _ in range(60):  # to where the ray meets the surface
        x, y, _ = np.moveaxis(pose[:3, 3] + rays * depth[..., None], -1, 0)
        surface = 2 + relief * (np.sin(3.1 * x + 0.4) + np.cos(2.6 * y) + 0.5 * np.sin(4 * (x + y)))
        depth = (surface - pose[2, 3]) / rays[..., 2]
    x, y, _ = np.moveaxis(pose[:3, 3] + rays * depth[..., None], -1, 0)
    paint = 128 + contrast * (0.5 * np.sin(11 * x + 3 * y) + 0.5 * np.cos(9 * y - 4 * x) * np.sin(5 * x))
    shades = np.stack([paint, 0.9 * paint, 255 - paint], axis=-1).round().clip(1, 255).astype(np.uint8)
    colour = reference.pack_colour(shades)
    if holes is not None:
        random = np.random.default_rng(holes)
        depth[random.random(depth.shape) < 0.05] = 0
        colour[random.random(depth.shape) < 0.01] = 0
    return Seen(camera, depth, normal_map(depth, camera), colour)


def moved(*twist: float) -> np.ndarray:
    """A pose (4, 4) from a translation in metres and a rotation vector."""
    return exponential(np.array(twist, float))


def upload(session: Session, seen: Seen, image: RgbdImage | None = None) -> RgbdImage:
    image = image or RgbdImage.allocate(session, seen.camera)
    session.upload(image.depth, seen.depth.astype(np.float32))
    session.upload(image.colour, seen.colour)
    for plane, values in zip(image.normals, planes(seen.normals), strict=True):
        session.upload(plane, values)
    return image


def levels_of(seen: Seen, count: int, reach: float) -> list[reference.Level]:
    """The reference's pyramid."""
    depth, normals, brightness = seen.depth, seen.normals, reference.intensity(seen.colour)
    levels = []
    for camera in cameras_of(seen.camera, count):
        levels.append(reference.Level(camera, depth, normals, brightness, *reference.gradient(brightness)))
        normals = reference.half_sample_normals(depth, normals, reach)
        depth, brightness = half_sample(depth, reach), reference.half_sample_intensity(brightness)
    return levels
