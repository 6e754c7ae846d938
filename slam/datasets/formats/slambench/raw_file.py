"""SLAMBench 1's `.raw` files.

Little-endian, a frame after the other: u32 width, u32 height, u16 depth in millimetres, u32 width, u32
height, u8 red green blue. There are no intrinsics and no stamps; frames run at 30 Hz.
"""

from __future__ import annotations

import hashlib
import struct
from functools import cached_property
from pathlib import Path

import numpy as np
import numpy.typing as npt

from slam.datasets.formats.output import whole_file
from slam.datasets.sequence import (
    Progress,
    Sequence,
    SequenceError,
    make_camera,
    read_truth,
    regular_timestamps,
)

_SIZE = struct.Struct("<II")


class RawSequence(Sequence):
    """Frames read one by one from the file; every frame's two headers are checked when it is read."""

    def __init__(
        self, path: Path, intrinsics: tuple[float, float, float, float], truth: Path | None = None
    ) -> None:
        self.name = path.stem
        self._path = path
        width, height = self._first_size()
        self.camera = make_camera(intrinsics, (width, height), path)
        self._frame_bytes = 2 * _SIZE.size + 5 * width * height
        total = path.stat().st_size
        if total % self._frame_bytes:
            raise SequenceError(
                f"{path} has {total} bytes, which is not a whole number of {width}x{height} frames "
                f"({self._frame_bytes} bytes each): it is cut short in frame {total // self._frame_bytes}, "
                "holds images of several sizes or is not a SLAMBench 1 file"
            )
        self.timestamps = regular_timestamps(total // self._frame_bytes)
        if truth is not None:
            numbers = np.arange(len(self.timestamps))
            self.truth = read_truth(truth, self.camera, self.timestamps, numbers)

    def _first_size(self) -> tuple[int, int]:
        with self._path.open("rb") as file:
            header = file.read(_SIZE.size)
        if len(header) < _SIZE.size:
            raise SequenceError(f"{self._path} is empty: a .raw file begins with u32 width, u32 height")
        width, height = _SIZE.unpack(header)
        if not (0 < width <= 16384 and 0 < height <= 16384):
            raise SequenceError(f"{self._path} begins with the size {width}x{height}: not a SLAMBench 1 file")
        return width, height

    def depth(self, index: int) -> npt.NDArray[np.uint16]:
        shape = (self.camera.height, self.camera.width)
        data = self._read(index, 0, 2 * shape[0] * shape[1])
        return np.frombuffer(data, "<u2").astype(np.uint16).reshape(shape)

    def colour(self, index: int) -> npt.NDArray[np.uint8] | None:
        shape = (self.camera.height, self.camera.width, 3)
        begin = _SIZE.size + 2 * shape[0] * shape[1]
        return np.frombuffer(self._read(index, begin, 3 * shape[0] * shape[1]), np.uint8).reshape(shape)

    def _read(self, index: int, begin: int, count: int) -> bytes:
        """`count` bytes of a frame after the size at `begin`."""
        self.check_index(index)
        with self._path.open("rb") as file:
            file.seek(index * self._frame_bytes + begin)
            size = _SIZE.unpack(file.read(_SIZE.size))
            data = file.read(count)
        if size != (self.camera.width, self.camera.height):
            raise SequenceError(
                f"{self._path}, frame {index}: the size {size[0]}x{size[1]} where "
                f"{self.camera.width}x{self.camera.height} was expected: the file is damaged"
            )
        return data

    @cached_property
    def sha256(self) -> str:
        """Over the whole file."""
        with self._path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()


def write(sequence: Sequence, path: Path, progress: Progress | None = None) -> None:
    """Write any sequence as a `.raw` file; frames without colour get black. The file appears when whole."""
    size = _SIZE.pack(sequence.camera.width, sequence.camera.height)
    black = np.zeros((sequence.camera.height, sequence.camera.width, 3), np.uint8)
    with whole_file(path) as file:
        for index in range(len(sequence)):
            colour = sequence.colour(index)
            file.write(size + sequence.depth(index).astype("<u2").tobytes())
            file.write(size + (black if colour is None else colour).tobytes())
            if progress:
                progress(index + 1, len(sequence))
