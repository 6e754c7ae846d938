"""Sequences rendered from the geometry of a synthetic scene: anyone can make them again, with exact truth."""

from __future__ import annotations

import hashlib
from functools import cached_property, lru_cache
from typing import Literal

import numpy as np
import numpy.typing as npt

from slam.camera import Camera
from slam.datasets.sequence import Sequence, regular_timestamps
from slam.datasets.synthetic import kinect
from slam.datasets.synthetic.camera_paths import SEED
from slam.datasets.synthetic.scenes.scene import SyntheticScene
from slam.datasets.synthetic.shapes import View, paint, render

Noise = Literal["kinect", "none"]

CAMERA = Camera(481.2, 480.0, 319.5, 239.5, 640, 480)


class SyntheticSequence(Sequence):
    """`frames` frames of `scene` at 30 Hz (default: the scene's own number), rendered when asked for.

    Equal arguments give equal frames. Noise "kinect" gives what the scene's Kinect would measure, "none" the
    exact depth rounded to millimetres. Of a picture of 640x480, `ratio` keeps every n-th pixel: 4 gives
    160x120. Raises ValueError for fewer frames than 1.
    """

    def __init__(
        self,
        scene: SyntheticScene,
        frames: int | None = None,
        noise: Noise = "kinect",
        seed: int = SEED,
        ratio: int = 1,
    ) -> None:
        count = scene.frames if frames is None else frames
        if count < 1:
            raise ValueError(f"frames={count}: a sequence has at least one")
        self.name = scene.name
        self.camera = CAMERA.scaled(ratio)
        self.timestamps = regular_timestamps(count)
        self.volume_size, self.initial_position = scene.volume_size, scene.initial_position
        self._sensor = scene.sensor
        self._noise = noise
        self._seed = seed
        self._shapes = scene.shapes(seed)
        self._blind = np.array([shape.mirror for shape in self._shapes])
        self._albedo = np.array([shape.albedo for shape in self._shapes])
        self._distortion = None
        if self._sensor.distortion:
            self._distortion = kinect.make_distortion(self.camera, np.random.default_rng([seed, 4]))
        self._poses = scene.poses(self.timestamps, seed)
        self.truth = self._poses
        # Depth and colour of a frame share one rendering.
        self._view = lru_cache(maxsize=1)(self._render)

    def _render(self, index: int) -> View:
        return render(self._shapes, self.camera, self._poses[index])

    def depth(self, index: int) -> npt.NDArray[np.uint16]:
        self.check_index(index)
        view = self._view(index)
        blind = (view.shape < 0) | self._blind[view.shape]
        if self._noise == "none":
            return np.where(blind, 0, np.rint(1000 * np.where(blind, 0, view.depth))).astype(np.uint16)
        rng = np.random.default_rng([self._seed, 3, index])
        albedo = self._albedo[view.shape]
        return kinect.measure(view.depth, blind, self.camera, rng, self._sensor, albedo, self._distortion)

    def colour(self, index: int) -> npt.NDArray[np.uint8]:
        self.check_index(index)
        return paint(self._shapes, self.camera, self._poses[index], self._view(index))

    @cached_property
    def sha256(self) -> str:
        """Over all depth images, so all are rendered."""
        digest = hashlib.sha256()
        for index in range(len(self)):
            digest.update(self.depth(index).tobytes())
        return digest.hexdigest()
