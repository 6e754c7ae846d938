"""The kernels that look at the map, in NumPy, under their own names: slow, and obviously right.

Surfels are arrays of SURFEL, poses (4, 4) camera to world, images (height, width) and (height, width, 3), all
float64. A view is a pose, `seen` (the first and the last tick of a surfel's last measurement, both included)
and the least confidence.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from slam.camera import Camera
from slam.elasticfusion.configuration import FARTHEST
from slam.elasticfusion.mapping.visible import BAND, bands_of
from tests.slam.numpy_kernels.dense import vertex_map

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
NO_SURFEL = -1
BEND = 8.0  # radii that the rim of a disc is bent backwards when depths are compared


def discs(surfels: NDArray[Any], pose: Array) -> tuple[Array, Array, Array]:
    """Middles (n, 3), normals (n, 3) and radii (n,) in the camera's frame."""
    to_camera = np.linalg.inv(pose)
    middles = surfels["position"].astype(float) @ to_camera[:3, :3].T + to_camera[:3, 3]
    return middles, surfels["normal"].astype(float) @ to_camera[:3, :3].T, surfels["radius"].astype(float)


def wanted(surfels: NDArray[Any], pose: Array, seen: tuple[int, int], confidence: float) -> NDArray[np.bool_]:
    """Which are alive, confident, in the window, in front of the camera and not too far."""
    depth = discs(surfels, pose)[0][:, 2]
    alive = (surfels["confidence"] > 0) & (surfels["confidence"] >= confidence)
    in_window = (surfels["last_seen"] >= seen[0]) & (surfels["last_seen"] <= seen[1])
    return np.asarray(alive & in_window & (depth > 0) & (depth <= FARTHEST))


def cull_discs(
    surfels: NDArray[Any], pose: Array, seen: tuple[int, int], confidence: float, camera: Camera
) -> tuple[Integers, Integers]:
    """The ids of the discs that may cover a pixel, and their bins, by projecting many points of their rims.

    Those are seen that face the camera, lie wholly in front of it and span the middles of a row and a column.
    """
    middles, normals, radii = discs(surfels, pose)
    ids, bins = [], []
    angles = np.linspace(0, 2 * np.pi, 720, endpoint=False)
    for i in np.flatnonzero(wanted(surfels, pose, seen, confidence)):
        first = np.cross(normals[i], np.eye(3)[np.argmin(abs(normals[i]))])
        first /= np.linalg.norm(first)
        second = np.cross(normals[i], first)
        rim = middles[i] + radii[i] * (np.outer(np.cos(angles), first) + np.outer(np.sin(angles), second))
        if rim[:, 2].min() <= 0 or normals[i] @ middles[i] >= 0:
            continue
        u = camera.fx * rim[:, 0] / rim[:, 2] + camera.cx
        v = camera.fy * rim[:, 1] / rim[:, 2] + camera.cy
        left, right = max(np.ceil(u.min()), 0), min(np.floor(u.max()), camera.width - 1)
        top, bottom = max(np.ceil(v.min()), 0), min(np.floor(v.max()), camera.height - 1)
        if left <= right and top <= bottom:
            ids.append(i)
            tall = bottom >= (top // BAND + 2) * BAND
            bins.append(bands_of(camera.height) if tall else int(top // BAND))
    return np.array(ids, int), np.array(bins, int)


def cull_points(
    surfels: NDArray[Any], pose: Array, seen: tuple[int, int], confidence: float, camera: Camera
) -> tuple[Integers, Integers]:
    """The ids of the surfels whose middle falls into a pixel, and the bands of those pixels."""
    columns, rows, _ = pixels_of(surfels, pose, camera)
    inside = (columns >= 0) & (columns < camera.width) & (rows >= 0) & (rows < camera.height)
    ids = np.flatnonzero(wanted(surfels, pose, seen, confidence) & inside)
    return ids, rows[ids] // BAND


def pixels_of(surfels: NDArray[Any], pose: Array, camera: Camera) -> tuple[Integers, Integers, Array]:
    """Column and row of the pixel nearest to each surfel's middle (-1 behind the camera), and its depth."""
    x, y, depth = discs(surfels, pose)[0].T
    z = np.where(depth > 0, depth, np.nan)
    column, row = np.rint(camera.fx * x / z + camera.cx), np.rint(camera.fy * y / z + camera.cy)
    return np.nan_to_num(column, nan=-1).astype(int), np.nan_to_num(row, nan=-1).astype(int), depth


def bin_offsets(bins: Integers, bands: int) -> Integers:
    """Where each of the bands + 1 bins begins, and where the last ends."""
    return np.concatenate([[0], np.cumsum(np.bincount(bins, minlength=bands + 1))])


def scatter(ids: Integers, bins: Integers) -> Integers:
    """The ids bin after bin, in each in their order."""
    return ids[np.argsort(bins, kind="stable")]


def clear_view(camera: Camera) -> tuple[Array, Integers]:
    """Nearness and ids of a view that sees nothing."""
    return np.zeros((camera.height, camera.width)), np.full((camera.height, camera.width), NO_SURFEL)


def splat(
    surfels: NDArray[Any], pose: Array, seen: tuple[int, int], confidence: float, camera: Camera
) -> tuple[Array, Integers]:
    """At each pixel the nearness of the nearest disc that its ray meets from the front, and that disc's id.

    Nearness is the inverse depth of the disc bent backwards: at distance s from its middle by
    BEND s^2 / radius.
    """
    middles, normals, radii = discs(surfels, pose)
    usable = wanted(surfels, pose, seen, confidence) & ((middles * normals).sum(axis=1) < 0)
    usable &= middles[:, 2] > radii * np.sqrt(1 - np.minimum(normals[:, 2] ** 2, 1))  # wholly in front
    nearness, ids = clear_view(camera)
    for y, x in np.ndindex(camera.height, camera.width):
        ray = np.array([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, 1.0])
        slopes = normals @ ray
        facing = usable & (slopes < 0)
        depth = np.where(facing, (normals * middles).sum(axis=1), 1) / np.where(facing, slopes, 1)
        distance = np.linalg.norm(depth[:, None] * ray - middles, axis=1)
        bent = BEND * distance**2 / np.where(facing, radii, 1)
        key = np.where(facing & (distance <= radii), (1 - bent / depth) / depth, 0)
        if key.max() > 0:
            ids[y, x] = key.argmax()  # of equals the first
            nearness[y, x] = key.max()
    return nearness, ids


def resolve(
    ids: Integers, surfels: NDArray[Any], pose: Array, camera: Camera
) -> tuple[Array, Array, NDArray[np.uint32], NDArray[np.int32], Array]:
    """Of what each pixel sees: depth, normal in the camera's frame, colour, birth and confidence; else 0."""
    covered = ids != NO_SURFEL
    who = surfels[np.where(covered, ids, 0)]
    middles, normals, _ = (part.reshape(*ids.shape, -1) for part in discs(who.ravel(), pose))
    rays = vertex_map(np.ones(ids.shape), camera)
    slopes = np.where(covered, (normals * rays).sum(axis=-1), 1)
    depth = np.where(covered, (normals * middles).sum(axis=-1) / slopes, 0)
    normals = np.where(covered[..., None], normals, 0)
    return depth, normals, who["colour"] * covered, who["first_seen"] * covered, who["confidence"] * covered


def covered_of_rows(depth: Array) -> Integers:
    """How many pixels of each row are covered."""
    return (depth > 0).sum(axis=1)


def clear_index(camera: Camera) -> tuple[Array, Integers]:
    """Depths and ids of an index map without surfels."""
    return np.full((camera.height, camera.width), np.inf), np.full((camera.height, camera.width), NO_SURFEL)


def index_surfels(
    surfels: NDArray[Any], pose: Array, seen: tuple[int, int], confidence: float, camera: Camera
) -> Integers:
    """At each pixel the id of the nearest surfel whose middle falls into it."""
    depths, ids = clear_index(camera)
    columns, rows, depth = pixels_of(surfels, pose, camera)
    for i in cull_points(surfels, pose, seen, confidence, camera)[0]:
        if depth[i] < depths[rows[i], columns[i]]:
            depths[rows[i], columns[i]], ids[rows[i], columns[i]] = depth[i], i
    return ids


def fill_in(
    predicted: tuple[Array, Array, Array],
    live: tuple[Array, Array, Array],
    keep_depth: bool,
    keep_colour: bool,
    holes: bool,
) -> tuple[Array, Array, Array]:
    """Depth, normals and colour: the predicted ones where they are kept, else the live ones.

    With `holes` the live ones also where nothing is predicted.
    """
    geometry = ((predicted[0] > 0) | (not holes)) & keep_depth
    painted = ((predicted[2] > 0) | (not holes)) & keep_colour
    return (
        np.where(geometry, predicted[0], live[0]),
        np.where(geometry[..., None], predicted[1], live[1]),
        np.where(painted, predicted[2], live[2]),
    )


def sample_image(image: NDArray[Any], ratio: int) -> NDArray[Any]:
    """The pixel in the middle of each block of ratio x ratio."""
    height, width = image.shape[0] // ratio, image.shape[1] // ratio
    return image[ratio // 2 :: ratio, ratio // 2 :: ratio][:height, :width]
