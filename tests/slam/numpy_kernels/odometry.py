"""The kernels of preprocessing, pyramid, odometry and rotation in NumPy, under their own names.

Images are (height, width), vector images (height, width, 3), poses (4, 4) from one camera's frame to
another's, all float64; colours uint32.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slam.camera import Camera
from tests.slam.numpy_kernels.dense import nearest_pixel, point_to_plane, solve_symmetric, vertex_map

Array = NDArray[np.float64]


def pack_colour(image: NDArray[np.uint8], ratio: int = 1) -> NDArray[np.uint32]:
    """Every `ratio`-th pixel (height, width, 3) to red | green << 8 | blue << 16; black becomes (1, 1, 1)."""
    red, green, blue = np.moveaxis(image[::ratio, ::ratio].astype(np.uint32), -1, 0)
    packed = red | green << 8 | blue << 16
    return np.where(packed == 0, np.uint32(0x010101), packed)


def intensity(colour: NDArray[np.uint32]) -> Array:
    """Brightness from 0 to 255 (ITU-R BT.601)."""
    return (colour & 255) * 0.299 + (colour >> 8 & 255) * 0.587 + (colour >> 16 & 255) * 0.114


def half_sample_intensity(fine: Array) -> Array:
    """4x4 binomial weights around the middle of each 2x2 block, over what has a brightness."""
    height, width = fine.shape[0] // 2, fine.shape[1] // 2
    weights = np.outer([1, 3, 3, 1], [1, 3, 3, 1])
    coarse = np.zeros((height, width))
    for y, x in np.ndindex(height, width):
        rows = np.clip(np.arange(2 * y - 1, 2 * y + 3), 0, fine.shape[0] - 1)
        columns = np.clip(np.arange(2 * x - 1, 2 * x + 3), 0, fine.shape[1] - 1)
        window = fine[np.ix_(rows, columns)]
        if (window > 0).any():
            coarse[y, x] = (weights * window).sum() / (weights * (window > 0)).sum()
    return coarse


def half_sample_normals(depth: Array, normals: Array, range_threshold: float) -> Array:
    """The mean direction of those normals of each 2x2 block whose depth is near that of its first pixel."""
    height, width = depth.shape[0] // 2, depth.shape[1] // 2
    coarse = np.zeros((height, width, 3))
    for y, x in np.ndindex(height, width):
        block = np.s_[2 * y : 2 * y + 2, 2 * x : 2 * x + 2]
        near = np.abs(depth[block] - depth[2 * y, 2 * x]) < range_threshold
        total = normals[block][near].sum(axis=0)
        if depth[2 * y, 2 * x] > 0 and total.any():
            coarse[y, x] = total / np.linalg.norm(total)
    return coarse


def gradient(brightness: Array) -> tuple[Array, Array]:
    """Brightness per pixel to the right and down; 0 at the sides and beside pixels without brightness."""
    side, middle = 0.52201, 0.79451
    smooth = np.array([side, middle, side]) / (2 * (2 * side + middle))
    kernel = np.outer(smooth, [-1, 0, 1])
    across, down = np.zeros_like(brightness), np.zeros_like(brightness)
    for y in range(1, brightness.shape[0] - 1):
        for x in range(1, brightness.shape[1] - 1):
            window = brightness[y - 1 : y + 2, x - 1 : x + 2]
            if (window > 0).all():
                across[y, x], down[y, x] = (kernel * window).sum(), (kernel.T * window).sum()
    return across, down


@dataclass(frozen=True)
class Level:
    """One level of a pyramid: what `slam.elasticfusion.tracking.pyramid.PyramidLevel` holds on the device."""

    camera: Camera
    depth: Array
    normals: Array
    intensity: Array
    gradient_x: Array
    gradient_y: Array


def list_steep_pixels(level: Level, least_gradient: float, farthest: float) -> list[list[int]]:
    """The columns, row by row, where brightness is steep and depth is known."""
    steep = np.hypot(level.gradient_x, level.gradient_y) >= least_gradient
    steep &= (level.depth > 0) & (level.depth <= farthest)
    return [[int(x) for x in np.flatnonzero(row)] for row in steep]


@dataclass
class Sums:
    """The normal equations of a registration, and what its errors amount to."""

    matrix: Array
    right_side: Array
    icp_squared_error: float = 0.0
    icp_inliers: int = 0
    rgb_squared_error: float = 0.0
    rgb_inliers: int = 0

    @classmethod
    def empty(cls) -> Sums:
        return cls(np.zeros((6, 6)), np.zeros(6))

    def add(self, jacobian: Array, error: float) -> None:
        self.matrix += np.outer(jacobian, jacobian)
        self.right_side += jacobian * error


def brightness_row(
    point: Array, source_pixel: tuple[int, int], source: Level, target: Level
) -> tuple[Array, float, tuple[int, int]] | None:
    """Gradient by the twist, difference and the target's pixel of a source pixel moved to `point`, or None.

    A point (x, y, z) moves by the twist (t, w) as t + w x point, its image as the camera's derivative says.
    """
    camera = target.camera
    projection = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]]) @ point
    pixel = nearest_pixel(projection, camera.width, camera.height)
    if pixel is None or target.intensity[pixel] == 0:
        return None
    x, y, z = point
    beyond = projection[:2] / z - np.array(pixel[::-1])
    slope = np.array([target.gradient_x[pixel], target.gradient_y[pixel]])
    other = np.array([source.gradient_x[source_pixel], source.gradient_y[source_pixel]])
    mean = (slope + other) / 2
    derivative = np.array(
        [[camera.fx / z, 0, -camera.fx * x / z**2], [0, camera.fy / z, -camera.fy * y / z**2]]
    )
    towards = mean @ derivative
    jacobian = np.concatenate([towards, np.cross(point, towards)])
    difference = source.intensity[source_pixel] - (target.intensity[pixel] + slope @ beyond)
    return jacobian, float(difference), pixel


def equations(
    source: Level,
    target: Level,
    listed: list[list[int]],
    pose: Array,
    icp_weight: float,
    rgb_weight: float,
    noise: float,
    max_distance: float,
    min_dot: float,
    max_depth_difference: float,
) -> Sums:
    """Both errors' normal equations: rows of geometry times icp_weight, of brightness as documented."""
    sums = Sums.empty()
    camera = target.camera
    points = vertex_map(source.depth, source.camera) @ pose[:3, :3].T + pose[:3, 3]
    partners = vertex_map(target.depth, camera)
    projection = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
    for source_pixel in np.ndindex(source.depth.shape):
        pixel = nearest_pixel(projection @ points[source_pixel], camera.width, camera.height)
        if pixel is None or target.depth[pixel] == 0 or icp_weight == 0:
            continue
        normal = pose[:3, :3] @ source.normals[source_pixel]
        row = point_to_plane(
            points[source_pixel], normal, partners[pixel], target.normals[pixel], max_distance, min_dot
        )
        if row is not None:
            sums.add(icp_weight * row[0], icp_weight * row[1])
            sums.icp_squared_error += row[1] ** 2
            sums.icp_inliers += 1
    for source_pixel in ((y, x) for y, columns in enumerate(listed) for x in columns if rgb_weight > 0):
        equation = brightness_row(points[source_pixel], source_pixel, source, target)
        if equation is None:
            continue
        jacobian, difference, pixel = equation
        depth = target.depth[pixel]
        if depth == 0 or abs(depth - points[source_pixel][2]) > max_depth_difference:
            continue
        weight = rgb_weight / (noise + abs(difference))
        sums.add(weight * jacobian, weight * difference)
        sums.rgb_squared_error += difference**2
        sums.rgb_inliers += 1
    return sums


def measure_noise(sums: Sums) -> float:
    """The root mean square of the differences of brightness, at least one grey level."""
    return max(float(np.sqrt(sums.rgb_squared_error / sums.rgb_inliers)), 1.0) if sums.rgb_inliers else 1.0


def so3_linearise(present: Level, earlier: Level, rotation: Array) -> tuple[Array, Array, float, int]:
    """J^T J (3, 3), J^T e (3), the sum of e^2 and the pixels that took part, over three angles."""
    sums, squared_error, inliers = Sums.empty(), 0.0, 0
    rays = vertex_map(np.ones_like(present.intensity), present.camera) @ rotation.T
    for pixel in np.ndindex(present.intensity.shape):
        if present.intensity[pixel] == 0:
            continue
        equation = brightness_row(rays[pixel], pixel, present, earlier)
        if equation is not None:
            sums.add(equation[0], equation[1])
            squared_error += equation[1] ** 2
            inliers += 1
    return sums.matrix[3:, 3:], sums.right_side[3:], squared_error, inliers


def turn(
    matrix: Array, right_side: Array, squared_error: float, inliers: int, least: float, needed: float
) -> Array | None:
    """The next rotation vector, or None where the mean squared error is not below `least`, or the pixels
    that took part are fewer than `needed`.
    """
    if inliers == 0 or inliers < needed or squared_error / inliers >= least:
        return None
    return solve_symmetric(matrix, right_side)
