"""Random ferns: which earlier view looks like this one (Glocker et al. 2015).

A fern looks at one random pixel and compares its three colours and its depth with thresholds: four bits. The
bits of all ferns are a view's code; views of one place from about the same pose have many equal ones.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slam.camera import Camera
from slam.elasticfusion.loops.graph import Deformation
from slam.elasticfusion.loops.thumbnail import Thumbnail

Array = NDArray[np.float64]
Code = NDArray[np.uint8]
Pixels = tuple[NDArray[np.intp], NDArray[np.intp]]

FERNS = 500
NEAREST_THRESHOLD = 0.4  # metres, of the depths that ferns compare with
UNSEEN = np.uint8(255)  # the bits of a fern whose pixel has no depth: they match nothing


@dataclass(frozen=True)
class Keyframe:
    """A view that was kept: the pose (4, 4) it was seen from, and the tick."""

    view: Thumbnail
    pose: Array
    tick: int


class Ferns:
    """The keyframes of a run and their codes. Equal seeds look at equal pixels with equal thresholds."""

    def __init__(self, camera: Camera, depth_cutoff: float, seed: int) -> None:
        random = np.random.default_rng(seed)
        self.rows = random.integers(0, camera.height, FERNS)
        self.columns = random.integers(0, camera.width, FERNS)
        self._colours = random.integers(0, 256, (FERNS, 3))
        self._depths = random.uniform(min(NEAREST_THRESHOLD, depth_cutoff), depth_cutoff, FERNS)
        self._codes = np.empty((0, FERNS), np.uint8)
        self.keyframes: list[Keyframe] = []

    def encode(self, view: Thumbnail) -> Code:
        """The code (FERNS,): of each fern the bits red, green, blue and depth, or UNSEEN."""
        depth = view.depth[self.rows, self.columns]
        above = channels(view.colour[self.rows, self.columns]) > self._colours
        bits = above @ np.array([1, 2, 4]) + 8 * (depth > self._depths)
        return np.where(depth > 0, bits, UNSEEN).astype(np.uint8)

    def dissimilarities(self, code: Code) -> Array:
        """Of each keyframe (k,): the share of ferns that differ, of those that saw something in both views.

        The share is of the smaller of the two numbers of ferns that saw something, so that a view with little
        depth differs from a full one; a view without any differs from all by 1.
        """
        seen = np.minimum((code != UNSEEN).sum(), (self._codes != UNSEEN).sum(axis=1))
        return np.asarray(1 - self._matches(code) / np.maximum(seen, 1))

    def agreement(self, code: Code, key: int) -> float:
        """The share of equal ferns among those that saw something in both this view and keyframe `key`."""
        common = int(((code != UNSEEN) & (self._codes[key] != UNSEEN)).sum())
        return float(self._matches(code)[key] / max(common, 1))

    def most_similar(self, code: Code, before: int) -> int | None:
        """The keyframe seen before that tick which differs least (of equals, the first); None without one."""
        old = np.array([key.tick < before for key in self.keyframes], dtype=bool)
        if not old.any():
            return None
        return int(np.argmin(np.where(old, self.dissimilarities(code), np.inf)))

    def add(self, view: Thumbnail, pose: Array, tick: int, threshold: float) -> bool:
        """Keep the view if it differs from all keyframes by more than `threshold`; whether it was kept."""
        code = self.encode(view)
        if self.keyframes and not self.dissimilarities(code).min() > threshold:
            return False
        if not (code != UNSEEN).any():
            return False
        self._codes = np.vstack([self._codes, code])
        self.keyframes.append(Keyframe(view, pose.copy(), tick))
        return True

    def deform(self, deformation: Deformation) -> None:
        """Move the keyframes' poses with the map."""
        if not self.keyframes:
            return
        poses = np.array([key.pose for key in self.keyframes])
        ticks = np.array([key.tick for key in self.keyframes])
        moved = deformation.of_poses(poses, ticks)
        self.keyframes = [replace(key, pose=pose) for key, pose in zip(self.keyframes, moved, strict=True)]

    def points(self, view: Thumbnail, step: int = 1) -> Array:
        """The points (p, 3) at every `step`-th fern's pixel with depth, in the camera's frame."""
        rows, columns = self.rows[::step], self.columns[::step]
        depth = view.depth[rows, columns].astype(np.float64)
        camera = view.camera
        points = np.column_stack(
            [(columns - camera.cx) / camera.fx * depth, (rows - camera.cy) / camera.fy * depth, depth]
        )
        return np.asarray(points[depth > 0])

    def colour_distance(self, view: Thumbnail, key: Keyframe, motion: Array) -> float:
        """Mean L1 distance of colours (three channels of 0 to 255) at the ferns' pixels.

        `motion` (4, 4) takes points of the view's camera to the keyframe's, where they are looked up at the
        nearest pixel. Infinite where no point falls onto a coloured pixel.
        """
        seen = view.depth[self.rows, self.columns] > 0
        colours = channels(view.colour[self.rows[seen], self.columns[seen]])
        inside, pixels = looked_up(self.points(view), motion, key.view.camera)
        target = key.view.colour[pixels]
        valid = target != 0
        if not valid.any():
            return float("inf")
        differences = np.abs(colours[inside][valid] - channels(target[valid]))
        return float(differences.sum(axis=1).mean())

    def _matches(self, code: Code) -> NDArray[np.int64]:
        """Of each keyframe (k,): how many ferns saw something in both views and have equal bits."""
        return np.asarray(((self._codes == code) & (code != UNSEEN)).sum(axis=1))


def overlap(view: Thumbnail, key: Thumbnail, motion: Array) -> float:
    """The share of the view's pixels that show a surface and, moved as in colour_distance, fall onto one.

    Only pixels with a normal count, in both: others take no part in a registration.
    """
    measured = view.normals.any(axis=-1)
    _, pixels = looked_up(view.vertices[measured].astype(np.float64), motion, key.camera)
    return float(key.normals[pixels].any(axis=-1).sum() / measured.size)


def looked_up(points: Array, motion: Array, camera: Camera) -> tuple[NDArray[np.bool_], Pixels]:
    """Which points (p, 3), once moved, the camera sees, and at which pixels (rows, columns) it sees those."""
    x, y, z = (points @ motion[:3, :3].T + motion[:3, 3]).T
    with np.errstate(divide="ignore", invalid="ignore"):
        u = np.floor(camera.fx * x / z + camera.cx + 0.5)
        v = np.floor(camera.fy * y / z + camera.cy + 0.5)
    inside = (z > 0) & (u >= 0) & (u < camera.width) & (v >= 0) & (v < camera.height)
    return inside, (v[inside].astype(int), u[inside].astype(int))


def channels(packed: NDArray[np.uint32]) -> NDArray[np.int64]:
    """Red, green and blue (n, 3) of packed colours (n,)."""
    return (packed[:, None] >> np.array([0, 8, 16], np.uint32) & 255).astype(np.int64)
