"""A sequence held in memory, for tests of what reads and writes sequences."""

from __future__ import annotations

import hashlib

import numpy as np

from slam.camera import Camera
from slam.datasets import Sequence
from slam.datasets.sequence import regular_timestamps


class ArraySequence(Sequence):
    def __init__(self, depth, colour=None, truth=None, name="arrays", **scene):
        self.name = name
        self._depth = np.asarray(depth, np.uint16)
        self._colour = colour
        frames, height, width = self._depth.shape
        self.camera = Camera(width * 0.8, width * 0.81, width / 2 - 0.5, height / 2 - 0.5, width, height)
        self.timestamps = regular_timestamps(frames)
        self.truth = truth
        self.volume_size = scene.get("volume_size")
        self.initial_position = scene.get("initial_position")

    def depth(self, index):
        self.check_index(index)
        return self._depth[index]

    def colour(self, index):
        return None if self._colour is None else self._colour[index]

    @property
    def sha256(self):
        return hashlib.sha256(self._depth.tobytes()).hexdigest()


def random_poses(count, rng, step=0.01):
    """A smooth random walk of poses, (count, 4, 4), about `step` metres a frame."""
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, 3] = np.cumsum(rng.normal(0, step, (count, 3)), axis=0)
    for pose in poses:
        pose[:3, :3] = random_rotation(rng)
    return poses


def random_rotation(rng):
    Q, R = np.linalg.qr(rng.normal(size=(3, 3)))
    Q *= np.sign(np.diag(R))
    return Q if np.linalg.det(Q) > 0 else -Q
