"""A synthetic living room, seen by a hand-held Kinect: the sequence that clients measure.

It is computed from geometry of our own (furniture.py), so its ground truth is exact and anyone can make it
again. The motion is brisk enough, with two hurried stretches, that careless configurations lose track.
"""

from __future__ import annotations

import hashlib
import math
from functools import cached_property, lru_cache
from typing import Literal

import numpy as np
import numpy.typing as npt

from slam.camera import Camera
from slam.datasets import kinect
from slam.datasets.furniture import living_room, turn
from slam.datasets.sequence import Sequence, regular_timestamps
from slam.datasets.shapes import View, paint, render

Noise = Literal["kinect", "none"]

CAMERA = Camera(481.2, 480.0, 319.5, 239.5, 640, 480)
SEED = 7
FRAMES = 100
# The whole furnished end of the room lies inside this cube, whose axes are those of the first camera.
VOLUME_SIZE = 4.8
INITIAL_POSITION = (0.5, 0.48, 0.1)

START = np.array([-0.1, -1.4, -1.2])
# Hand-held motion is a sum of slow swings and of a tremor. Swings: amplitude and hertz.
SWING_POSITION = (((0.22, 0.30), (0.03, 0.85)), ((0.08, 0.37), (0.02, 1.0)), ((0.13, 0.27), (0.02, 0.9)))
SWING_ANGLE = (((7.0, 0.33), (0.8, 0.9)), ((3.0, 0.41), (0.6, 1.1)), ((2.2, 0.36), (0.5, 0.8)))
GAZE = (6.0, -14.0, 0.0)  # degrees of yaw, pitch and roll at rest: a little downwards
TREMOR_HERTZ = (3.1, 4.7, 6.3, 8.9)
TREMOR_POSITION = 0.0005  # metres
TREMOR_ANGLE = 0.06  # degrees
STILL = 0.1  # seconds without any motion: KinectFusion takes frames 0 to 3 for granted
SETTLE = 0.4  # seconds after which the motion has half its size
HURRY = 0.025  # seconds by which the swings run ahead and fall behind, twice a second


class LivingRoom(Sequence):
    """`frames` frames at 30 Hz, rendered when asked for; equal seeds give equal frames.

    Noise "kinect" gives what a Kinect would measure, "none" the exact depth rounded to millimetres.
    """

    def __init__(self, frames: int = FRAMES, noise: Noise = "kinect", seed: int = SEED) -> None:
        if frames < 1:
            raise ValueError(f"frames={frames}: a sequence has at least one")
        self.name = "living-room"
        self.camera = CAMERA
        self.timestamps = regular_timestamps(frames)
        self.volume_size = VOLUME_SIZE
        self.initial_position = INITIAL_POSITION
        self._noise = noise
        self._seed = seed
        self._shapes = living_room(seed)
        self._blind = np.array([shape.mirror for shape in self._shapes])
        self._poses = poses(self.timestamps, seed)
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


def poses(timestamps: npt.NDArray[np.float64], seed: int = SEED) -> npt.NDArray[np.float64]:
    """The camera's poses (n, 4, 4) in the room at some seconds."""
    rng = np.random.default_rng([seed, 2])
    seconds = np.maximum(timestamps - STILL, 0)
    started = seconds**2 / (seconds**2 + SETTLE**2)
    hurried = started * (seconds + HURRY * np.sin(2 * math.pi * 2 * seconds))
    tremor = started[:, None] * _tremor(seconds, rng)
    position = START + _swing(hurried, SWING_POSITION) + TREMOR_POSITION * tremor[:, :3]
    angles = GAZE + _swing(hurried, SWING_ANGLE) + TREMOR_ANGLE * tremor[:, 3:]
    result = np.tile(np.eye(4), (len(timestamps), 1, 1))
    result[:, :3, 3] = position
    result[:, :3, :3] = [turn(*row) for row in angles]
    return result


def _swing(
    seconds: npt.NDArray[np.float64], axes: tuple[tuple[tuple[float, float], ...], ...]
) -> npt.NDArray[np.float64]:
    return np.stack(
        [
            sum(amplitude * np.sin(2 * math.pi * hertz * seconds) for amplitude, hertz in axis)
            for axis in axes
        ],
        axis=1,
    )


def _tremor(seconds: npt.NDArray[np.float64], rng: np.random.Generator) -> npt.NDArray[np.float64]:
    """Six unit tremors (n, 6): a few fast sines of random phase each."""
    phases = rng.uniform(0, 2 * math.pi, (6, len(TREMOR_HERTZ)))
    waves = np.sin(2 * math.pi * seconds[:, None, None] * np.array(TREMOR_HERTZ) + phases)
    return np.asarray(waves.sum(axis=2))
