"""The kernels of fusion, cleaning, compaction and deforming in NumPy: slow, and obviously right.

Images are (height, width), normals (height, width, 3) in the camera's frame, poses (4, 4) camera to world,
all float64; maps are arrays of SURFEL, and index maps int (height, width), -1 where they hold nothing.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slam.camera import Camera
from slam.elasticfusion.loops.graph import Deformation
from slam.elasticfusion.mapping import fusion as constants

Array = NDArray[np.float64]
Map = NDArray[Any]
NOTHING, NEW = -2, -1


def measures(raw: Array, normals: Array, x: int, y: int) -> bool:
    """Whether a pixel has its own depth and normal, and four neighbours with depth."""
    height, width = raw.shape
    if not (0 < x < width - 1 and 0 < y < height - 1):
        return False
    around = [raw[y, x], raw[y, x - 1], raw[y, x + 1], raw[y - 1, x], raw[y + 1, x]]
    return bool(min(around) > 0 and normals[y, x].any())


def all_new(raw: Array, normals: Array) -> NDArray[np.intp]:
    """NEW for every pixel that measures a surfel, NOTHING elsewhere."""
    height, width = raw.shape
    return np.array(
        [[NEW if measures(raw, normals, x, y) else NOTHING for x in range(width)] for y in range(height)]
    )


def associate(
    raw: Array, normals: Array, camera: Camera, ids: NDArray[np.intp], surfels: Map, pose: Array, phase: int
) -> NDArray[np.intp]:
    """For each fused pixel: the pixel of the index map whose surfel it measures, NEW or NOTHING."""
    height, width = raw.shape
    matches = np.full((-(-height // 2), -(-width // 2)), NOTHING)
    for row, column in np.ndindex(matches.shape):
        x, y = 2 * column + phase, 2 * row + phase
        if not measures(raw, normals, x, y):
            continue
        matches[row, column] = NEW
        ray = np.array([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, 1.0])
        nearest = np.inf
        for dy in (-1, 0, 1):
            for dx in (-1, 0, 1):
                surfel = surfels[ids[y + dy, x + dx]]
                if ids[y + dy, x + dx] < 0:
                    continue
                point = pose[:3, :3].T @ (surfel["position"] - pose[:3, 3])
                normal = pose[:3, :3].T @ surfel["normal"]
                if abs(point[2] - raw[y, x]) * np.linalg.norm(ray) >= constants.ASSOCIATION_DISTANCE:
                    continue
                alike = normal @ normals[y, x] > constants.ASSOCIATION_NORMAL
                if not (abs(normal[2]) < constants.SLANTED or alike):
                    continue
                across = float(np.linalg.norm(np.cross(ray, point)) / np.linalg.norm(ray))
                if across < nearest:
                    nearest, matches[row, column] = across, (y + dy) * width + x + dx
    return matches


def measured(
    raw: Array, filtered: Array, normals: Array, camera: Camera, x: int, y: int
) -> tuple[Array, float]:
    """The position in the camera's frame and the radius of what a pixel measures."""
    z = raw[y, x]
    point = np.array([(x - camera.cx) / camera.fx * z, (y - camera.cy) / camera.fy * z, z])
    radius = np.sqrt(2) * filtered[y, x] / ((abs(camera.fx) + abs(camera.fy)) / 2)
    return point, float(min(radius / max(abs(normals[y, x, 2]), 1e-9), 2 * radius))


def confidence(camera: Camera, x: int, y: int, weight: float) -> float:
    """Of a measurement, by its distance from the principal point."""
    rho = np.hypot(x - camera.cx, y - camera.cy) / (np.hypot(camera.width, camera.height) / 2)
    return float(weight * np.exp(-(rho**2) / 0.72))


def update(
    raw: Array,
    filtered: Array,
    normals: Array,
    colour: NDArray[np.uint32],
    camera: Camera,
    ids: NDArray[np.intp],
    matches: NDArray[np.intp],
    surfels: Map,
    pose: Array,
    weight: float,
    tick: int,
) -> Map:
    """The map after the weighted means; the first of the pixels that match a surfel counts."""
    surfels, taken = surfels.copy(), set()
    for row, column in np.ndindex(matches.shape):
        match = matches[row, column]
        if match < 0 or match in taken:
            continue
        taken.add(match)
        x, y = 2 * column + tick % 2, 2 * row + tick % 2
        surfel = surfels[ids.ravel()[match]].copy()
        point, radius = measured(raw, filtered, normals, camera, x, y)
        old, fresh = float(surfel["confidence"]), confidence(camera, x, y, weight)
        if radius < constants.MOST_COARSENING * surfel["radius"]:
            means = {
                "position": (surfel["position"], pose[:3, :3] @ point + pose[:3, 3]),
                "normal": (surfel["normal"], pose[:3, :3] @ normals[y, x]),
                "radius": (surfel["radius"], radius),
            }
            for name, (before, now) in means.items():
                surfel[name] = (old * before + fresh * now) / (old + fresh)
            surfel["normal"] /= np.linalg.norm(surfel["normal"])
            if colour[y, x] and surfel["colour"]:
                pairs = [(surfel["colour"] >> s & 0xFF, colour[y, x] >> s & 0xFF, s) for s in (0, 8, 16)]
                mixed = [int((old * a + fresh * b) / (old + fresh) + 0.5) << s for a, b, s in pairs]
                surfel["colour"] = sum(mixed)
            elif colour[y, x]:
                surfel["colour"] = colour[y, x]
        surfel["confidence"], surfel["last_seen"] = old + fresh, tick
        surfels[ids.ravel()[match]] = surfel
    return surfels


def count_new(matches: NDArray[np.intp]) -> NDArray[np.intp]:
    """New surfels in each row."""
    return np.sum(matches == NEW, axis=1)


def scan_rows(row_new: NDArray[np.intp]) -> tuple[NDArray[np.intp], int]:
    """New surfels before each row, and in all."""
    return np.cumsum(row_new) - row_new, int(row_new.sum())


def append(
    raw: Array,
    filtered: Array,
    normals: Array,
    colour: NDArray[np.uint32],
    camera: Camera,
    ids: NDArray[np.intp],
    matches: NDArray[np.intp],
    surfels: Map,
    pose: Array,
    weight: float,
    tick: int,
    step: int,
    phase: int,
) -> tuple[Map, NDArray[np.intp]]:
    """The map with what is new in it, in the order of pixels, and the index map that shows it."""
    ids, fresh = ids.copy(), list[Any]()
    for row, column in zip(*np.nonzero(matches == NEW), strict=True):
        x, y = step * column + phase, step * row + phase
        point, radius = measured(raw, filtered, normals, camera, x, y)
        surfel = np.zeros((), surfels.dtype)
        surfel["position"], surfel["normal"] = (
            pose[:3, :3] @ point + pose[:3, 3],
            pose[:3, :3] @ normals[y, x],
        )
        surfel["radius"], surfel["confidence"] = radius, confidence(camera, x, y, weight)
        surfel["colour"], surfel["first_seen"], surfel["last_seen"] = colour[y, x], tick, tick
        shown = ids[y, x]
        if shown < 0 or (pose[:3, :3].T @ (surfels["position"][shown] - pose[:3, 3]))[2] > point[2]:
            ids[y, x] = len(surfels) + len(fresh)
        fresh.append(surfel)
    return np.concatenate([surfels, np.array(fresh, surfels.dtype)]), ids


def mark_for_removal(
    raw: Array, ids: NDArray[np.intp], surfels: Map, pose: Array, tick: int, threshold: float
) -> NDArray[np.bool_]:
    """Of each pixel whether its surfel is a double, by 4x4 samples around it, or was seen through."""
    height, width = ids.shape
    marked = np.zeros(ids.shape, np.bool_)
    for y in range(1, height - 1):
        for x in range(1, width - 1):
            if ids[y, x] < 0:
                continue
            surfel = surfels[ids[y, x]]
            point = pose[:3, :3].T @ (surfel["position"] - pose[:3, 3])
            doubles = 0
            for other in _samples(ids, x, y):
                if other < 0 or other == ids[y, x] or surfels["confidence"][other] < threshold:
                    continue
                offset = pose[:3, :3].T @ (surfels["position"][other] - pose[:3, 3]) - point
                older = surfels["first_seen"][other] < surfel["first_seen"]
                beside = np.hypot(*offset[:2]) < constants.DOUBLE_REACH * surfel["radius"]
                doubles += bool(0 < offset[2] < constants.DOUBLE_DISTANCE and older and beside)
            around = raw[y - 1 : y + 2, x - 1 : x + 2]
            behind = around[around > 0] > point[2] + constants.ASSOCIATION_DISTANCE
            seen_through = (
                len(behind) >= constants.SEEN_THROUGH and behind.all() and surfel["last_seen"] != tick
            )
            marked[y, x] = doubles > constants.DOUBLES or seen_through
    return marked


def _samples(ids: NDArray[np.intp], x: int, y: int) -> Iterator[int]:
    """What the index map holds at half-pixel steps around a pixel, from three quarters before it on."""
    steps = np.array([-0.75, -0.25, 0.25, 0.75])
    for dy in steps:
        for dx in steps:
            yield int(ids[round(y + dy), round(x + dx)])


def remove_marked(ids: NDArray[np.intp], marked: NDArray[np.bool_], surfels: Map) -> tuple[Map, int]:
    """The map without what was marked, and how many that were."""
    surfels = surfels.copy()
    surfels["confidence"][ids[marked]] = 0
    return surfels, int(marked.sum())


def remove_unstable(surfels: Map, first: int, last: int, threshold: float) -> tuple[Map, int]:
    """The map without unstable surfels last seen from tick `first` to `last`, and how many they were."""
    surfels = surfels.copy()
    unstable = (surfels["confidence"] > 0) & (surfels["confidence"] < threshold)
    gone = unstable & (surfels["last_seen"] >= first) & (surfels["last_seen"] <= last)
    surfels["confidence"][gone] = 0
    return surfels, int(gone.sum())


def count_living(surfels: Map, run: int) -> NDArray[np.intp]:
    """How many surfels live in each run of places."""
    return np.array([np.sum(surfels["confidence"][i : i + run] > 0) for i in range(0, len(surfels), run)])


def gather_living(surfels: Map) -> Map:
    """The living surfels, in their order."""
    return surfels[surfels["confidence"] > 0]


def deform(surfels: Map, deformation: Deformation) -> Map:
    """The map moved by the graph; normals by the inverse transpose of the mean linear map."""
    surfels = surfels.copy()
    living = surfels["confidence"] > 0
    moved, linear = deformation.of_points(
        surfels["position"][living].astype(float), surfels["first_seen"][living]
    )
    normals = np.einsum("pji,pj->pi", np.linalg.inv(linear), surfels["normal"][living])
    surfels["position"][living] = moved
    surfels["normal"][living] = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    return surfels


def reactivate(surfels: Map, depth: Array, camera: Camera, pose: Array, tick: int, threshold: float) -> Map:
    """The map with its stable surfels that lie on or in front of a surface seen at `tick`."""
    surfels = surfels.copy()
    for surfel in surfels:
        point = pose[:3, :3].T @ (surfel["position"] - pose[:3, 3])
        if surfel["confidence"] < threshold or point[2] <= 0:
            continue
        u = np.floor(camera.fx * point[0] / point[2] + camera.cx + 0.5)
        v = np.floor(camera.fy * point[1] / point[2] + camera.cy + 0.5)
        if not (0 <= u < camera.width and 0 <= v < camera.height):
            continue
        surface = depth[int(v), int(u)]
        if surface > 0 and point[2] < surface + 0.1:
            surfel["last_seen"] = tick
    return surfels


def sample_nodes(surfels: Map, every: int) -> Map:
    """Of every `every` places the first surfel that lives."""
    stretches = [surfels[i : i + every] for i in range(0, len(surfels), every)]
    return np.concatenate([stretch[stretch["confidence"] > 0][:1] for stretch in stretches])
