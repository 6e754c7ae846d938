"""A sequence whose images are cropped to a size that a configuration can divide."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from slam.datasets.sequence import DerivedSequence, Sequence


class Cropped(DerivedSequence):
    """The middle of `sequence`, `width` x `height` pixels of each image; the principal point moves with it.

    Of an odd margin the smaller part is cut off on the left or at the top.
    """

    def __init__(self, sequence: Sequence, width: int, height: int) -> None:
        super().__init__(sequence)
        whole = sequence.camera
        left, top = (whole.width - width) // 2, (whole.height - height) // 2
        self.cropped_from = (whole.width, whole.height)
        self.camera = replace(whole, cx=whole.cx - left, cy=whole.cy - top, width=width, height=height)
        self._rows, self._columns = slice(top, top + height), slice(left, left + width)

    def depth(self, index: int) -> npt.NDArray[np.uint16]:
        return np.ascontiguousarray(self._source.depth(index)[self._rows, self._columns])

    def colour(self, index: int) -> npt.NDArray[np.uint8] | None:
        colour = self._source.colour(index)
        return None if colour is None else np.ascontiguousarray(colour[self._rows, self._columns])

    @cached_property
    def sha256(self) -> str:
        return hashlib.sha256(f"{self._source.sha256} {self.camera}".encode()).hexdigest()


def cropped(sequence: Sequence, multiple: int) -> Sequence:
    """`sequence`, cropped to the largest images whose sides are multiples of `multiple` pixels.

    It is returned as it is where the sides fit, where nothing would be left, or where its size is fixed.
    """
    camera = sequence.camera
    width, height = camera.width - camera.width % multiple, camera.height - camera.height % multiple
    if sequence.fixed_size or not (width and height) or (width, height) == (camera.width, camera.height):
        return sequence
    return Cropped(sequence, width, height)
