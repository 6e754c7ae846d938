"""Solid shapes, and depth and colour images of them by casting one ray through every pixel centre.

Shapes are given in their own axes, y down like the camera's, and moved into the world by a rotation and a
centre. Everything is exact except the rounded box, whose surface is found by sphere tracing to 0.01 mm.
"""

from __future__ import annotations

from collections.abc import Sequence as Ordered
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import numpy.typing as npt

from slam.camera import Camera

Array = npt.NDArray[np.float64]
Kind = Literal["box", "ellipsoid", "frustum", "rounded"]
Pattern = Literal["plain", "wood", "weave", "speckle", "print", "paper"]

NEAREST = 0.05  # metres in front of the camera; nothing in a scene comes closer
TRACING_STEPS = 48
TRACING_PRECISION = 1e-5  # metres
CORNERS = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, 8).T
LIGHT = np.array([0.35, 0.8, 0.48])  # the direction in which light falls, from above and behind


@dataclass(frozen=True)
class Shape:
    """A solid with half extents `half` (3,), metres, around `centre` (3,), turned by `rotation` (3, 3).

    A frustum stands along its y axis: `top` is the radius of its upper end as a fraction of the lower end's
    `half[0]`; a cylinder has top 1. A rounded box has edges of radius `edge`. A shape that does not reflect
    (`mirror`) gives a depth camera nothing; `albedo` is the share of infrared light that others send back.
    """

    kind: Kind
    centre: Array
    half: Array
    rotation: Array = field(default_factory=lambda: np.eye(3))
    top: float = 1.0
    edge: float = 0.0
    colour: tuple[int, int, int] = (200, 200, 200)
    pattern: Pattern = "plain"
    mirror: bool = False
    albedo: float = 1.0


@dataclass(frozen=True)
class View:
    """A rendered view: `depth` (h, w) metres along the optical axis, infinite where there is nothing,
    and `shape` (h, w), the index of the shape seen or -1."""

    depth: Array
    shape: npt.NDArray[np.int32]


def render(shapes: Ordered[Shape], camera: Camera, pose: Array) -> View:
    """Cast a ray through every pixel centre; `pose` (4, 4) is camera to world."""
    depth = np.full((camera.height, camera.width), np.inf)
    seen = np.full((camera.height, camera.width), -1, np.int32)
    for index, shape in enumerate(shapes):
        rows, columns = _window(shape, camera, pose)
        if rows.start >= rows.stop or columns.start >= columns.stop:
            continue
        directions = _directions(camera, rows, columns) @ (pose[:3, :3].T @ shape.rotation)
        origin = (pose[:3, 3] - shape.centre) @ shape.rotation
        distance = _INTERSECTIONS[shape.kind](shape, origin, directions)
        nearer = distance < depth[rows, columns]
        depth[rows, columns][nearer] = distance[nearer]
        seen[rows, columns][nearer] = index
    return View(depth, seen)


def paint(shapes: Ordered[Shape], camera: Camera, pose: Array, view: View) -> npt.NDArray[np.uint8]:
    """Colour (h, w, 3) of a view: the shapes' patterns under one distant light and some ambient light."""
    whole = slice(0, camera.height), slice(0, camera.width)
    depth = np.where(np.isfinite(view.depth), view.depth, 0.0)
    points = depth[..., None] * (_directions(camera, *whole) @ pose[:3, :3].T) + pose[:3, 3]
    # Normals from neighbouring points: at silhouettes they lean, which reads as a thin dark contour.
    across, down = np.gradient(points, axis=1), np.gradient(points, axis=0)
    normal = np.cross(down, across)
    normal /= np.maximum(np.linalg.norm(normal, axis=2, keepdims=True), 1e-12)
    light = 0.45 + 0.55 * np.abs(normal @ (LIGHT / np.linalg.norm(LIGHT)))
    image = np.zeros((camera.height, camera.width, 3))
    for index in np.unique(view.shape[view.shape >= 0]):
        shape = shapes[index]
        pixels = view.shape == index
        local = (points[pixels] - shape.centre) @ shape.rotation
        texture = _texture(shape.pattern, local, int(index))
        image[pixels] = np.array(shape.colour) * (texture * light[pixels])[:, None]
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def _directions(camera: Camera, rows: slice, columns: slice) -> Array:
    """Rays (rows, columns, 3) in the camera's axes with z = 1, so that a ray's parameter is its depth."""
    v, u = np.mgrid[rows, columns].astype(np.float64)
    return np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones_like(u)], axis=-1)


def _window(shape: Shape, camera: Camera, pose: Array) -> tuple[slice, slice]:
    """Rows and columns outside which the shape cannot be seen, from the corners of its bounding box."""
    corners = (CORNERS * shape.half) @ shape.rotation.T + shape.centre
    x, y, z = ((corners - pose[:3, 3]) @ pose[:3, :3]).T
    if z.max() < NEAREST:
        return slice(0, 0), slice(0, 0)
    if z.min() < NEAREST:
        return slice(0, camera.height), slice(0, camera.width)
    u, v = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
    rows = slice(max(0, int(np.floor(v.min()))), min(camera.height, int(np.ceil(v.max())) + 1))
    columns = slice(max(0, int(np.floor(u.min()))), min(camera.width, int(np.ceil(u.max())) + 1))
    return rows, columns


def _slabs(half: Array, origin: Array, directions: Array) -> tuple[Array, Array]:
    """Entry and exit of rays into a box around zero; the entry lies behind the exit where it is missed."""
    with np.errstate(divide="ignore", invalid="ignore"):
        one, other = (-half - origin) / directions, (half - origin) / directions
    # fmin and fmax pass over NaN, which a ray inside the plane of a face produces.
    return np.fmin(one, other).max(axis=-1), np.fmax(one, other).min(axis=-1)


def _box(shape: Shape, origin: Array, directions: Array) -> Array:
    entry, leave = _slabs(shape.half, origin, directions)
    return np.where((entry <= leave) & (entry > NEAREST), entry, np.inf)


def _ellipsoid(shape: Shape, origin: Array, directions: Array) -> Array:
    o, d = origin / shape.half, directions / shape.half
    a, b, c = np.sum(d * d, axis=-1), d @ o, o @ o - 1
    return _smaller_root(a, b, np.broadcast_to(c, a.shape))


def _frustum(shape: Shape, origin: Array, directions: Array) -> Array:
    """A cone's mantle between y = -half and +half, or one of the two discs that close it."""
    height = shape.half[1]
    radius = shape.half[0]
    # The radius grows linearly from the upper end (y = -height, since y points down) to the lower one.
    slope = radius * (1 - shape.top) / (2 * height)
    middle = radius * (1 + shape.top) / 2
    ox, oy, oz = origin
    dx, dy, dz = np.moveaxis(directions, -1, 0)
    at_origin = middle + slope * oy
    a = dx * dx + dz * dz - (slope * dy) ** 2
    b = dx * ox + dz * oz - slope * dy * at_origin
    c = np.broadcast_to(ox * ox + oz * oz - at_origin**2, a.shape)
    mantle = _smaller_root(a, b, c)
    with np.errstate(invalid="ignore"):
        mantle = np.where(np.abs(oy + mantle * dy) <= height, mantle, np.inf)
    nearest = mantle
    for end, end_radius in ((-height, radius * shape.top), (height, radius)):
        with np.errstate(divide="ignore", invalid="ignore"):
            disc = (end - oy) / dy
            inside = (ox + disc * dx) ** 2 + (oz + disc * dz) ** 2 <= end_radius**2
        nearest = np.where(inside & (disc > NEAREST) & (disc < nearest), disc, nearest)
    return nearest


def _rounded(shape: Shape, origin: Array, directions: Array) -> Array:
    entry, leave = _slabs(shape.half, origin, directions)
    result = np.full(entry.shape, np.inf)
    candidates = (entry <= leave) & (entry > NEAREST)
    d = directions[candidates]
    speed = np.linalg.norm(d, axis=1)
    t, last = entry[candidates], leave[candidates]
    inner = shape.half - shape.edge
    distance = np.full(t.shape, np.inf)
    for _ in range(TRACING_STEPS):
        outside = np.maximum(np.abs(origin + t[:, None] * d) - inner, 0)
        distance = np.sqrt(np.einsum("ij,ij->i", outside, outside)) - shape.edge
        if np.all((distance < TRACING_PRECISION) | (t > last)):
            break
        t = t + np.maximum(distance, 0) / speed
    result[candidates] = np.where((distance < 10 * TRACING_PRECISION) & (t <= last), t, np.inf)
    return result


def _smaller_root(a: Array, b: Array, c: Array) -> Array:
    """The first t > NEAREST with a t^2 + 2 b t + c = 0, for rays that start outside; else infinite."""
    discriminant = b * b - a * c
    with np.errstate(divide="ignore", invalid="ignore"):
        root = (-b - np.sqrt(discriminant)) / a
    return np.where((discriminant >= 0) & (root > NEAREST), root, np.inf)


_INTERSECTIONS = {"box": _box, "ellipsoid": _ellipsoid, "frustum": _frustum, "rounded": _rounded}


def _texture(pattern: Pattern, local: Array, seed: int) -> Array:
    """Brightness (n,) around 0.9 of points (n, 3) in a shape's own axes."""
    x, y, z = local.T
    if pattern == "plain":
        return 0.94 + 0.06 * _noise(local * 40, seed)
    if pattern == "wood":
        rings = np.sin(60 * (0.35 * x + z) + 9 * _noise(local * [2, 8, 8], seed))
        return np.asarray(0.82 + 0.1 * rings + 0.06 * _noise(local * 60, seed))
    if pattern == "weave":
        threads = np.sin(190 * x) * np.sin(190 * (y + z))
        return np.asarray(0.85 + 0.09 * threads + 0.06 * _noise(local * 25, seed))
    if pattern == "speckle":
        return np.where(_noise(local * 55, seed) > 0.2, 1.0, 0.75)
    if pattern == "paper":
        # Detail of every size, so that it stays visible from near and far and at every level of a pyramid.
        octaves = (
            weight * _noise(local * cells, seed) for cells, weight in ((4, 0.12), (13, 0.14), (42, 0.14))
        )
        return np.asarray(0.8 + sum(octaves))
    blocks = _noise(np.floor(local * 14) + 0.5, seed)
    return 0.7 + 0.3 * blocks + 0.1 * _noise(local * 30, seed)


def _noise(points: Array, seed: int) -> Array:
    """Smooth value noise in [-1, 1] of points (n, 3): hashed lattice values, blended between."""
    corner = np.floor(points).astype(np.int64)
    fraction = points - corner
    weight = fraction * fraction * (3 - 2 * fraction)
    total = np.zeros(len(points))
    for offset in np.ndindex(2, 2, 2):
        blend = np.prod(np.where(offset, weight, 1 - weight), axis=1)
        total += blend * _hash(corner + offset, seed)
    return total


def _hash(lattice: npt.NDArray[np.int64], seed: int) -> Array:
    """A fixed pseudo-random value in [-1, 1] for every lattice point (n, 3)."""
    mixed = lattice @ np.array([73856093, 19349663, 83492791]) + seed * 15485863
    state: npt.NDArray[np.uint64] = mixed.astype(np.uint64)
    for shift, factor in ((33, 0xFF51AFD7ED558CCD), (29, 0xC4CEB9FE1A85EC53)):
        state = (state ^ (state >> np.uint64(shift))) * np.uint64(factor)
    return (state >> np.uint64(40)).astype(np.float64) / 2**23 - 1
