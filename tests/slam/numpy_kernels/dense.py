"""The shared kernels in NumPy, under their own names: slow, and obviously right.

Images are (height, width), vector images (height, width, 3), poses (4, 4) from one camera's frame to
another's or to the world's, all float64.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slam.camera import Camera

Array = NDArray[np.float64]


def millimetres_to_metres(
    millimetres: NDArray[np.uint16], ratio: int, nearest: int = 0, farthest: int = 65535
) -> Array:
    """Every ratio-th pixel of a depth image, in metres; 0 where it is not within nearest and farthest."""
    sampled = millimetres[::ratio, ::ratio]
    return np.where((sampled >= nearest) & (sampled <= farthest), sampled / 1000.0, 0.0)


def bilateral_filter(depth: Array, radius: int, spatial_sigma: float, range_sigma: float) -> Array:
    """Tomasi and Manduchi 1998; pixels without depth stay so and count nowhere."""
    reach = range(-radius, radius + 1)
    return _bilateral(depth, [(dx, dy) for dy in reach for dx in reach], spatial_sigma, range_sigma)


def bilateral_filter_line(
    depth: Array, down: bool, radius: int, spatial_sigma: float, range_sigma: float
) -> Array:
    """The same over the pixels of a line: along the row or, where `down`, along the column."""
    offsets = [(0, d) if down else (d, 0) for d in range(-radius, radius + 1)]
    return _bilateral(depth, offsets, spatial_sigma, range_sigma)


def _bilateral(
    depth: Array, offsets: list[tuple[int, int]], spatial_sigma: float, range_sigma: float
) -> Array:
    """Over the neighbours at `offsets` (dx, dy)."""
    height, width = depth.shape
    filtered = np.zeros_like(depth)
    for y in range(height):
        for x in range(width):
            if depth[y, x] == 0:
                continue
            total = weights = 0.0
            for dx, dy in offsets:
                neighbour = depth[min(max(y + dy, 0), height - 1), min(max(x + dx, 0), width - 1)]
                if neighbour == 0:
                    continue
                difference = neighbour - depth[y, x]
                weight = np.exp(
                    -(difference**2) / (2 * range_sigma**2) - (dx**2 + dy**2) / (2 * spatial_sigma**2)
                )
                total += weight * neighbour
                weights += weight
            filtered[y, x] = total / weights
    return filtered


def half_sample(fine: Array, range_threshold: float) -> Array:
    """The mean of those of each 2x2 block that lie within the threshold of its first pixel."""
    height, width = fine.shape[0] // 2, fine.shape[1] // 2
    coarse = np.zeros((height, width))
    for y in range(height):
        for x in range(width):
            block = fine[2 * y : 2 * y + 2, 2 * x : 2 * x + 2]
            coarse[y, x] = block[np.abs(block - block[0, 0]) < range_threshold].mean()
    return coarse


def vertex_map(depth: Array, camera: Camera) -> Array:
    """The point in the camera's frame that each pixel sees."""
    y, x = np.mgrid[: depth.shape[0], : depth.shape[1]]
    return np.dstack([(x - camera.cx) / camera.fx * depth, (y - camera.cy) / camera.fy * depth, depth])


def normal_map(depth: Array, camera: Camera) -> Array:
    """Unit normals towards the camera; zero where one of the five pixels has no depth."""
    height, width = depth.shape
    vertices = vertex_map(depth, camera)
    side = np.sign(camera.fx * camera.fy)
    normals = np.zeros_like(vertices)
    for y in range(height):
        for x in range(width):
            above, below = vertices[max(y - 1, 0), x], vertices[min(y + 1, height - 1), x]
            left, right = vertices[y, max(x - 1, 0)], vertices[y, min(x + 1, width - 1)]
            if min(depth[y, x], above[2], below[2], left[2], right[2]) == 0:
                continue
            normal = side * np.cross(below - above, right - left)
            normals[y, x] = normal / np.linalg.norm(normal)
    return normals


def exponential(twist: Array) -> Array:
    """The motion (4, 4) of a twist (translation, rotation vector), as a power series of its matrix."""
    x, y, z = twist[3:]
    generator = np.zeros((4, 4))
    generator[:3, :3] = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
    generator[:3, 3] = twist[:3]
    motion, term = np.eye(4), np.eye(4)
    for order in range(1, 30):
        term = term @ generator / order
        motion += term
    return motion


def nearest_pixel(projected: Array, width: int, height: int) -> tuple[int, int] | None:
    """(row, column) nearest to image coordinates times depth; None behind the camera or outside."""
    if not projected[2] > 0:
        return None
    u, v = projected[:2] / projected[2] + 0.5
    if not (0 <= u <= width - 1 and 0 <= v <= height - 1):
        return None
    return int(v), int(u)


def point_to_plane(
    point: Array, normal: Array, target: Array, target_normal: Array, max_distance: float, min_dot: float
) -> tuple[Array, float] | None:
    """The row and the error of a point and its partner (Newcombe et al. 2011, eq. 16 to 19), or None.

    The unknowns are a translation and a rotation vector about the origin of the frame of all four.
    """
    if not normal.any() or not target_normal.any():
        return None
    if np.linalg.norm(target - point) > max_distance or normal @ target_normal < min_dot:
        return None
    jacobian = np.concatenate([target_normal, np.cross(point, target_normal)])
    return jacobian, float(target_normal @ (target - point))


def solve_symmetric(normal_matrix: Array, right_side: Array) -> Array:
    """The least-squares update; singular values of a millionth of the largest or less are dropped."""
    left, singular, right = np.linalg.svd(normal_matrix)
    kept = singular * 1e6 > singular[0]
    return np.asarray(right.T[:, kept] @ ((left.T @ right_side)[kept] / singular[kept]))
