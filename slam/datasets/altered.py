"""A sequence with a defect: dark or dropped frames, a badly calibrated camera, or perturbed depth."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from slam.datasets.sequence import DerivedSequence, Sequence, SequenceError


class Altered(DerivedSequence):
    """`sequence` without depth in the frames `dark` = (first, last), while the camera moves on, and with
    focal lengths that are reported too large by the fraction `focal_error`.

    With a focal length that is too long, rotations are underestimated: the trajectory drifts, and after a
    full turn the estimated pose is wrong. Without `truth_in_dark` the true poses of dark frames are unknown,
    so that errors count only in the other frames. Raises SequenceError for frames outside the sequence, or a
    fraction outside (-0.5, 0.5).
    """

    def __init__(
        self,
        sequence: Sequence,
        dark: tuple[int, int] | None = None,
        focal_error: float = 0.0,
        truth_in_dark: bool = True,
    ) -> None:
        if dark is not None and not 0 <= dark[0] <= dark[1] < len(sequence):
            raise SequenceError(
                f"dark frames {dark[0]} to {dark[1]}: give two of 0 to {len(sequence) - 1}, the smaller first"
            )
        if not -0.5 < focal_error < 0.5:
            raise SequenceError(f"focal error {focal_error:g}: give a fraction between -0.5 and 0.5")
        super().__init__(sequence)
        self._truth_in_dark = truth_in_dark
        self._dark = range(dark[0], dark[1] + 1) if dark else range(0)
        camera = sequence.camera
        self.camera = replace(camera, fx=camera.fx * (1 + focal_error), fy=camera.fy * (1 + focal_error))
        if sequence.truth is not None and not truth_in_dark:
            self.truth = sequence.truth.copy()
            self.truth[list(self._dark)] = np.nan

    def depth(self, index: int) -> npt.NDArray[np.uint16]:
        depth = self._source.depth(index)
        return np.zeros_like(depth) if index in self._dark else depth

    def colour(self, index: int) -> npt.NDArray[np.uint8] | None:
        colour = self._source.colour(index)
        return np.zeros_like(colour) if index in self._dark and colour is not None else colour

    @cached_property
    def sha256(self) -> str:
        truth = "" if self._truth_in_dark else " unknown"
        text = f"{self._source.sha256} {self.camera} {self._dark}{truth}"
        return hashlib.sha256(text.encode()).hexdigest()


class Perturbed(DerivedSequence):
    """`sequence` with each measured depth changed by -1, 0 or +1 of its units, as `seed` draws them.

    That is less than a sensor's noise. A configuration whose error depends on it is unstable: the rounding of
    another driver would change it as much. Raises SequenceError for a negative seed.
    """

    def __init__(self, sequence: Sequence, seed: int) -> None:
        if seed < 0:
            raise SequenceError(f"perturbation {seed}: give a whole number of 0 or more")
        super().__init__(sequence)
        self._seed = seed

    def depth(self, index: int) -> npt.NDArray[np.uint16]:
        depth = self._source.depth(index)
        rng = np.random.default_rng([self._seed, index])
        change = rng.integers(-1, 2, depth.shape, dtype=np.int32)
        changed = np.clip(depth + change, 1, np.iinfo(np.uint16).max)
        return np.where(depth > 0, changed, 0).astype(np.uint16)

    @cached_property
    def sha256(self) -> str:
        return hashlib.sha256(f"{self._source.sha256} perturbed {self._seed}".encode()).hexdigest()


class Dropped(DerivedSequence):
    """`sequence` without the part `share` of its frames, drawn at random by `seed`; the first is kept.

    Stamps stay, so the camera moves farther between some frames. Raises SequenceError for a share outside
    [0, 1) or a negative seed.
    """

    def __init__(self, sequence: Sequence, share: float, seed: int) -> None:
        if not 0 <= share < 1:
            raise SequenceError(f"dropped share {share:g}: give a fraction from 0 to below 1")
        if seed < 0:
            raise SequenceError(f"seed {seed}: give a whole number of 0 or more")
        super().__init__(sequence)
        kept = np.random.default_rng([seed, 6]).random(len(sequence)) >= share
        kept[0] = True
        self._kept = np.flatnonzero(kept)
        self.timestamps = sequence.timestamps[self._kept]
        if sequence.truth is not None:
            self.truth = sequence.truth[self._kept]

    def depth(self, index: int) -> npt.NDArray[np.uint16]:
        self.check_index(index)
        return self._source.depth(int(self._kept[index]))

    def colour(self, index: int) -> npt.NDArray[np.uint8] | None:
        self.check_index(index)
        return self._source.colour(int(self._kept[index]))

    @cached_property
    def sha256(self) -> str:
        return hashlib.sha256(f"{self._source.sha256} kept {self._kept.tolist()}".encode()).hexdigest()
