"""The deformation graph: nodes sampled from the map by first tick, and their influence on points.

Sumner et al. 2007 ("Embedded deformation for shape manipulation"), with the connectivity and the influence by
time of Whelan et al. 2015 (section 5): a surface may lie on top of one that was seen long ago, and must not
be moved with it.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from slam.camera import Camera
from slam.devices.opencl import defined
from slam.elasticfusion.configuration import REFERENCE_PIXELS

DEFORMING = Path(__file__).parents[1] / "kernels" / "deforming.cl"

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

NEIGHBOURS = defined(DEFORMING, "NEIGHBOURS")  # of a node, and nodes that move a point
CANDIDATES = 20  # nodes next in time, among which those that move a point are the nearest
LOCAL_SAMPLING = 5000  # surfels a node at REFERENCE_PIXELS
GLOBAL_SAMPLING = 5  # nodes of the local graph a node of the global one,
GLOBAL_NODES = 200  # as long as that leaves so many: among few nodes, those next in time are all there are
MOST_NODES = 1024


def sampling(surfels: int, camera: Camera) -> int:
    """The number of surfels per node, for a map of that many: smaller images make fewer surfels."""
    by_area = round(LOCAL_SAMPLING * camera.width * camera.height / REFERENCE_PIXELS)
    return max(1, by_area, -(-surfels // MOST_NODES))


@dataclass(frozen=True)
class Graph:
    """Nodes by age: `positions` float64 (n, 3) in the world, `times` int64 (n,), their first ticks."""

    positions: Array
    times: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.times)

    @property
    def usable(self) -> bool:
        """Whether there are enough nodes: the nearest but NEIGHBOURS gives the weights their scale."""
        return len(self) > NEIGHBOURS

    def thinned(self) -> Graph:
        """The graph of global closures: every GLOBAL_SAMPLING-th node, or more where the map is small."""
        step = int(np.clip(len(self) // GLOBAL_NODES, 1, GLOBAL_SAMPLING))
        return Graph(self.positions[::step], self.times[::step])

    def edges(self) -> Indices:
        """(m, 2): each node with each of its neighbours, the next in time: two before it and two after it.

        At the ends more of them lie on one side, so that every node has as many.
        """
        nodes = np.arange(len(self))
        first = np.clip(nodes - NEIGHBOURS // 2, 0, len(self) - 1 - NEIGHBOURS)
        neighbours = first[:, None] + np.arange(NEIGHBOURS + 1)
        pairs = np.stack([np.broadcast_to(nodes[:, None], neighbours.shape), neighbours], axis=-1)
        return np.asarray(pairs[neighbours != nodes[:, None]])

    def windows(self, times: NDArray[np.integer]) -> tuple[Indices, Indices]:
        """The nodes [first, last) that can move what was born at each of `times` (p,).

        They are the CANDIDATES nearest in time, with all that are as near as the last of them: the first
        frame makes many nodes of one tick, which only their position distinguishes.
        """
        count = min(CANDIDATES, len(self))
        first_seen = np.asarray(times, dtype=np.int64)
        starts, ends = self.times[: len(self) - count + 1], self.times[count - 1 :]
        after = np.clip(np.searchsorted(starts + ends, 2 * first_seen), 0, len(starts) - 1)
        before = np.maximum(after - 1, 0)
        reach = np.minimum(
            np.maximum(first_seen - starts[after], ends[after] - first_seen),
            np.maximum(first_seen - starts[before], ends[before] - first_seen),
        )
        return (
            np.searchsorted(self.times, first_seen - reach, side="left"),
            np.searchsorted(self.times, first_seen + reach, side="right"),
        )

    def influence(self, points: Array, times: NDArray[np.integer]) -> tuple[Indices, Array]:
        """The NEIGHBOURS nodes that move each of `points` (p, 3), and their weights, both (p, NEIGHBOURS).

        Of its window they are the nearest in space (of equals, the earlier), and weigh (1 - d / d_max)^2,
        d_max being the distance of the next node but those (Sumner et al. 2007, eq. 4); weights sum to 1.
        Where all are equally far, they weigh the same.
        """
        first, last = self.windows(times)
        widest = int((last - first).max(initial=0))
        candidates = first[:, None] + np.arange(widest)
        absent = candidates >= last[:, None]
        candidates = np.minimum(candidates, len(self) - 1)
        distances = np.linalg.norm(self.positions[candidates] - points[:, None], axis=-1)
        distances[absent] = np.inf
        order = np.argsort(distances, axis=1, kind="stable")[:, : NEIGHBOURS + 1]
        nearest = np.take_along_axis(distances, order, axis=1)
        farthest = np.maximum(nearest[:, -1:], np.finfo(float).tiny)
        weights = (1 - nearest[:, :-1] / farthest) ** 2
        total = weights.sum(axis=1, keepdims=True)
        weights = np.where(total > 0, weights / np.where(total > 0, total, 1), 1 / NEIGHBOURS)
        return np.take_along_axis(candidates, order[:, :-1], axis=1), weights


@dataclass(frozen=True)
class Deformation:
    """The motion of points near each node: x -> R (x - g) + g + t, with the node's position g.

    `rotations` (n, 3, 3), nearly orthonormal, and `translations` (n, 3), float64.
    """

    graph: Graph
    rotations: Array
    translations: Array

    def of_points(self, points: Array, times: NDArray[np.integer]) -> tuple[Array, Array]:
        """The new positions of points (p, 3) with first ticks `times` (p,), and their linear maps (p, 3, 3).

        Normals go by the inverse transpose of that map (Sumner et al. 2007, eq. 3 and section 4).
        """
        nodes, weights = self.graph.influence(points, times)
        g = self.graph.positions[nodes]
        turned = np.einsum("pkij,pkj->pki", self.rotations[nodes], points[:, None] - g)
        moved = np.einsum("pk,pki->pi", weights, turned + g + self.translations[nodes])
        return moved, np.einsum("pk,pkij->pij", weights, self.rotations[nodes])

    def of_poses(self, poses: Array, times: NDArray[np.integer]) -> Array:
        """Poses (p, 4, 4) of cameras at `times` (p,): centres go as points, rotations by the nearest one."""
        result = np.array(poses, dtype=np.float64)
        if len(result) == 0:
            return result
        result[:, :3, 3], linear = self.of_points(result[:, :3, 3], times)
        result[:, :3, :3] = nearest_rotations(linear @ result[:, :3, :3])
        return result


def nearest_rotations(matrices: Array) -> Array:
    """The rotations (p, 3, 3) nearest to matrices in the Frobenius norm."""
    U, _, Vt = np.linalg.svd(matrices)
    signs = np.ones(U.shape[:-1])
    signs[:, 2] = np.sign(np.linalg.det(U) * np.linalg.det(Vt))
    return np.asarray((U * signs[:, None, :]) @ Vt)
