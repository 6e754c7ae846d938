"""A synthetic living room, seen by a Kinect: the sequence that clients measure, and a loop with colour.

It is computed from geometry of our own (furniture.py), so its ground truth is exact and anyone can make it
again. The motion of the hand is brisk enough, with two hurried stretches, that careless configurations lose
track; the loop (camera_paths.py) shows the start again after one turn.
"""

from __future__ import annotations

import hashlib
from functools import cached_property, lru_cache
from typing import Literal

import numpy as np
import numpy.typing as npt

from slam.camera import Camera
from slam.datasets import camera_paths, kinect
from slam.datasets.camera_paths import SEED
from slam.datasets.furniture import living_room
from slam.datasets.sequence import Sequence, regular_timestamps
from slam.datasets.shapes import View, paint, render

Noise = Literal["kinect", "none"]
Path = Literal["hand", "loop"]

CAMERA = Camera(481.2, 480.0, 319.5, 239.5, 640, 480)
FRAMES = 100
# Side and start of a cube, whose axes are those of the first camera, around the furnished end of the room,
# which is all that the hand's path sees, and around the whole of it.
VOLUMES = {"hand": (4.8, (0.5, 0.48, 0.1)), "loop": (5.4, (0.5, 0.48, 0.5))}


class LivingRoom(Sequence):
    """`frames` frames at 30 Hz, rendered when asked for; equal seeds give equal frames.

    Noise "kinect" gives what a Kinect would measure, "none" the exact depth rounded to millimetres. Of a
    picture of 640x480, `ratio` keeps every n-th pixel: 4 gives 160x120. The room of the path "loop" has
    patterned walls and furniture all around, for colour and depth to hold on to.
    """

    def __init__(
        self,
        frames: int = FRAMES,
        noise: Noise = "kinect",
        seed: int = SEED,
        path: Path = "hand",
        ratio: int = 1,
    ) -> None:
        if frames < 1:
            raise ValueError(f"frames={frames}: a sequence has at least one")
        self.name = "living-room" if path == "hand" else f"living-room-{path}"
        self.camera = CAMERA.scaled(ratio)
        self.timestamps = regular_timestamps(frames)
        self.volume_size, self.initial_position = VOLUMES[path]
        self._noise = noise
        self._seed = seed
        self._shapes = living_room(seed, all_around=path == "loop")
        self._blind = np.array([shape.mirror for shape in self._shapes])
        move = camera_paths.loop if path == "loop" else camera_paths.hand_held
        self._poses = move(self.timestamps, seed)
        self.truth = self._poses
        # Depth and colour of a frame share one rendering.
        self._view = lru_cache(maxsize=1)(self._rendered)

    def _rendered(self, index: int) -> View:
        return render(self._shapes, self.camera, self._poses[index])

    def depth(self, index: int) -> npt.NDArray[np.uint16]:
        self.check_index(index)
        view = self._view(index)
        blind = (view.shape < 0) | self._blind[view.shape]
        if self._noise == "none":
            return np.where(blind, 0, np.rint(1000 * np.where(blind, 0, view.depth))).astype(np.uint16)
        return kinect.measure(view.depth, blind, self.camera, np.random.default_rng([self._seed, 3, index]))

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
