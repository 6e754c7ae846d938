"""The surface of a distance field as triangles: marching cubes (Lorensen and Cline 1987), and PLY files."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

SLAB = 8  # layers of cells taken at once: 512^3 voxels then need some 50 MB here


class DistanceField(Protocol):
    """Signed distances at the centres of resolution^3 voxels of `voxel_size` metres."""

    resolution: int
    voxel_size: float

    def read(self, first: int, last: int) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
        """Distances (positive in free space) and weights (0: never observed) of planes along z, (z, y, x)."""


@runtime_checkable
class Volumetric(Protocol):
    """A system that holds a distance field."""

    @property
    def volume(self) -> DistanceField: ...


@dataclass(frozen=True)
class Mesh:
    """`vertices` and `normals` float32 (n, 3), metres in the volume's frame; `triangles` int32 (m, 3).

    Triangles run counter-clockwise seen from free space, where the normals point.
    """

    vertices: NDArray[np.float32]
    normals: NDArray[np.float32]
    triangles: NDArray[np.int32]

    def write(self, path: Path) -> None:
        """Write a binary little-endian PLY file."""
        vertices = np.hstack([self.vertices, self.normals]).astype("<f4")
        faces = np.empty(len(self.triangles), [("count", "u1"), ("corners", "<i4", 3)])
        faces["count"], faces["corners"] = 3, self.triangles
        properties = "".join(f"property float {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz"))
        header = (
            "ply\nformat binary_little_endian 1.0\ncomment metres, in the frame of the trajectory\n"
            f"element vertex {len(vertices)}\n{properties}"
            f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
        )
        with path.open("wb") as file:
            file.write(header.encode("ascii"))
            file.write(vertices.data)
            file.write(faces.tobytes())


def extract(field: DistanceField) -> Mesh:
    """The zero crossing of a field, over cells whose eight corners were all observed.

    Neighbouring cells agree on the face between them, so the mesh is closed except where observation ends.
    Empty arrays where there is no surface. Memory grows with the surface and not with the volume.
    """
    key_parts, vertex_parts, triangle_parts = [], [], []
    for keys, vertices, corners in _slabs(field):
        key_parts.append(keys)
        vertex_parts.append(vertices)
        triangle_parts.append(corners)
    if not key_parts:
        nothing = np.zeros((0, 3), np.float32)
        return Mesh(nothing, nothing, np.zeros((0, 3), np.int32))
    # Slabs share the vertices of the plane between them.
    keys, first = np.unique(np.concatenate(key_parts), return_index=True)
    vertices = np.concatenate(vertex_parts)[first]
    triangles = np.searchsorted(keys, np.concatenate(triangle_parts)).astype(np.int32)
    return Mesh(vertices, _normals(vertices, triangles), triangles)


def _slabs(
    field: DistanceField,
) -> Iterator[tuple[NDArray[np.int64], NDArray[np.float32], NDArray[np.int64]]]:
    """Of each slab with a surface: its vertices' keys, ascending, and positions, and its triangles' keys."""
    for first in range(0, field.resolution - 1, SLAB):
        last = min(first + SLAB + 1, field.resolution)
        distances, weights = field.read(first, last)
        triangles = _triangles(distances, weights, first)
        if len(triangles):
            keys = np.unique(triangles)
            yield keys, _positions(keys, distances, first, field.voxel_size), triangles


def _triangles(distances: NDArray[np.float32], weights: NDArray[np.uint8], first: int) -> NDArray[np.int64]:
    """Triangles (m, 3) of the cells between planes; corners are keys of grid edges.

    A key is three times the index of the edge's lower voxel in the whole volume, plus the edge's axis.
    """
    inside, observed = distances < 0, weights > 0
    cells = tuple(size - 1 for size in distances.shape)
    case = np.zeros(cells, np.uint8)
    complete = np.ones(cells, np.bool_)
    for corner in range(8):
        at = tuple(slice(step, step + size) for step, size in zip(_offset(corner), cells, strict=True))
        case |= inside[at].astype(np.uint8) << corner
        complete &= observed[at]
    z, y, x = np.nonzero(complete & (case != 0) & (case != 255))
    side = distances.shape[1]
    starts, counts, edges = _table()
    kind = case[z, y, x]
    repeats = counts[kind]
    # Row by row: the triangles of the first cell, then those of the second ...
    order = np.arange(repeats.sum()) - np.repeat(np.cumsum(repeats) - repeats, repeats)
    rows = edges[np.repeat(starts[kind], repeats) + order]
    base = ((z + first) * side + y) * side + x
    lower = [(*_offset(corner), axis) for corner, axis in _LOWER]
    steps = np.array([3 * ((dz * side + dy) * side + dx) + axis for dz, dy, dx, axis in lower], np.int64)
    places: NDArray[np.int64] = 3 * np.repeat(base, repeats)[:, None] + steps[rows]
    return places


def _positions(
    keys: NDArray[np.int64], distances: NDArray[np.float32], first: int, voxel_size: float
) -> NDArray[np.float32]:
    """The zero crossing of the distance along each edge, in metres, x y z."""
    side = distances.shape[1]
    voxel, axis = np.divmod(keys, 3)
    lower = np.stack([voxel // side**2 - first, voxel // side % side, voxel % side])
    upper = lower.copy()
    upper[2 - axis, np.arange(len(keys))] += 1
    begin, end = (distances[tuple(at)].astype(np.float64) for at in (lower, upper))
    points = lower[::-1].T.astype(np.float64)
    points[:, 2] += first
    points[np.arange(len(keys)), axis] += begin / (begin - end)
    return ((points + 0.5) * voxel_size).astype(np.float32)


def _normals(vertices: NDArray[np.float32], triangles: NDArray[np.int32]) -> NDArray[np.float32]:
    """Unit normals: the mean of those of the triangles around a vertex, weighted by area."""
    a, b, c = (vertices[triangles[:, corner]].astype(np.float64) for corner in range(3))
    across = np.cross(b - a, c - a)
    total = np.zeros((len(vertices), 3))
    for axis in range(3):
        for corner in range(3):
            total[:, axis] += np.bincount(triangles[:, corner], across[:, axis], len(vertices))
    length = np.linalg.norm(total, axis=1, keepdims=True)
    normals: NDArray[np.float64] = np.divide(total, length, out=np.zeros_like(total), where=length > 0)
    return normals.astype(np.float32)


def _offset(corner: int) -> tuple[int, int, int]:
    """Corner 0 to 7 of a cell as steps along z, y, x: bit 0 is x, bit 1 is y, bit 2 is z."""
    return corner >> 2, corner >> 1 & 1, corner & 1


# The twelve edges of a cell: their lower corner and axis (0 x, 1 y, 2 z); their numbers by their two corners.
_LOWER = [(corner, axis) for axis in range(3) for corner in range(8) if not corner >> axis & 1]
_NUMBERS = {frozenset((corner, corner | 1 << axis)): number for number, (corner, axis) in enumerate(_LOWER)}


def _faces() -> list[tuple[int, int, int, int]]:
    """The corners of the six faces, counter-clockwise seen from outside the cell."""
    faces = []
    for axis in range(3):
        u, v = 1 << (axis + 1) % 3, 1 << (axis + 2) % 3
        faces.append((0, v, u | v, u))
        far = 1 << axis
        faces.append((far, far | u, far | u | v, far | v))
    return faces


@cache
def _table() -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Where the triangles of each of the 256 cases start, how many they are, and all triangles' edges.

    The table is derived: on each face the surface runs from edge to edge so that inside corners at opposite
    ends of a diagonal stay apart, a choice that both cells at the face make alike. The lines on the six faces
    close to polygons, which are cut into triangles.
    """
    starts, counts = [], []
    rows: list[tuple[int, int, int]] = []
    for case in range(256):
        triangles = [triangle for polygon in _polygons(case) for triangle in _cut(polygon)]
        starts.append(len(rows))
        counts.append(len(triangles))
        rows += triangles
    return np.array(starts), np.array(counts), np.array(rows)


def _polygons(case: int) -> list[list[int]]:
    """Closed polygons over the edges' numbers, counter-clockwise seen from the corners outside."""
    follows: dict[int, int] = {}
    for face in _faces():
        inside = [bool(case >> corner & 1) for corner in face]
        edges = [_NUMBERS[frozenset((face[i], face[(i + 1) % 4]))] for i in range(4)]
        leaving = [i for i in range(4) if inside[i] and not inside[(i + 1) % 4]]
        for i in leaving:
            # Back along the face to where this run of inside corners began.
            entered = next(j % 4 for j in range(i - 1, i - 5, -1) if not inside[j % 4])
            follows[edges[entered]] = edges[i]
    polygons = []
    while follows:
        first, here = next(iter(follows.items()))
        polygon = [first]
        del follows[first]
        while here != first:
            polygon.append(here)
            here = follows.pop(here)
        polygons.append(polygon)
    return polygons


def _cut(polygon: list[int]) -> Iterator[tuple[int, int, int]]:
    """Triangles of a polygon, ear by ear. No diagonal lies on a face: the next cell might have it."""
    rest = list(polygon)
    while len(rest) > 3:
        ear = next(i for i in range(len(rest)) if not _share_face(rest[i - 1], rest[(i + 1) % len(rest)]))
        yield rest[ear - 1], rest[ear], rest[(ear + 1) % len(rest)]
        del rest[ear]
    yield rest[0], rest[1], rest[2]


def _share_face(first: int, second: int) -> bool:
    """Whether two edges lie on one face of the cell."""
    return any(
        {first, second} <= {_NUMBERS[frozenset((face[i], face[(i + 1) % 4]))] for i in range(4)}
        for face in _faces()
    )
