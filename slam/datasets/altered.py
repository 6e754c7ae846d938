"""A sequence with something amiss: frames in the dark, or a camera that was badly calibrated."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from slam.datasets.sequence import Sequence, SequenceError


class Altered(Sequence):
    """`sequence` with nothing to see in the frames `dark` = (first, last), while the camera moves on, and
    with focal lengths that claim to be larger by the fraction `focal_error` than those it was taken with.

    A camera whose focal length is thought too long seems to turn too little: it drifts, and when it has
    turned round it believes itself elsewhere. Raises SequenceError for frames that there are not, or a
    fraction of -0.5 or less, or 0.5 or more.
    """

    def __init__(
        self, sequence: Sequence, dark: tuple[int, int] | None = None, focal_error: float = 0.0
    ) -> None:
        if dark is not None and not 0 <= dark[0] <= dark[1] < len(sequence):
            raise SequenceError(
                f"dark frames {dark[0]} to {dark[1]}: give two of 0 to {len(sequence) - 1}, the smaller first"
            )
        if not -0.5 < focal_error < 0.5:
            raise SequenceError(f"focal error {focal_error:g}: give a fraction between -0.5 and 0.5")
        camera = sequence.camera
        self._sequence = sequence
        self._dark = range(dark[0], dark[1] + 1) if dark else range(0)
        self.name = sequence.name
        self.camera = replace(camera, fx=camera.fx * (1 + focal_error), fy=camera.fy * (1 + focal_error))
        self.timestamps = sequence.timestamps
        self.truth = sequence.truth
        self.volume_size = sequence.volume_size
        self.initial_position = sequence.initial_position

    def depth(self, index: int) -> npt.NDArray[np.uint16]:
        depth = self._sequence.depth(index)
        return np.zeros_like(depth) if index in self._dark else depth

    def colour(self, index: int) -> npt.NDArray[np.uint8] | None:
        colour = self._sequence.colour(index)
        return np.zeros_like(colour) if index in self._dark and colour is not None else colour

    @cached_property
    def sha256(self) -> str:
        text = f"{self._sequence.sha256} {self.camera} {self._dark}"
        return hashlib.sha256(text.encode()).hexdigest()
