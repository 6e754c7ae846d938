"""A sequence whose depth is decoded once: later processes read the decoded frames from a folder."""

from __future__ import annotations

import contextlib
import os
import zlib
from pathlib import Path

import numpy as np
import numpy.typing as npt

from slam.datasets.sequence import Sequence

CHECK_BYTES = 4  # of the CRC-32 behind the depth


class Decoded(Sequence):
    """`sequence` with its decoded depth kept below `folder`, a file for each frame.

    A file is written when its frame is first read. A damaged one is written again. Where `folder` cannot be
    written, each frame is decoded as without it. A frame takes 2 bytes a pixel: 100 frames of 640x480 take
    61 MB. Several processes may share a folder.
    """

    def __init__(self, sequence: Sequence, folder: Path) -> None:
        self._sequence = sequence
        self._folder = folder / sequence.sha256
        self.name = sequence.name
        self.camera = sequence.camera
        self.timestamps = sequence.timestamps
        self.truth = sequence.truth
        self.volume_size = sequence.volume_size
        self.initial_position = sequence.initial_position

    def depth(self, index: int) -> npt.NDArray[np.uint16]:
        self.check_index(index)
        path = self._folder / f"{index}.depth"
        known = _read(path, self.camera.height, self.camera.width)
        if known is not None:
            return known
        depth = self._sequence.depth(index)
        with contextlib.suppress(OSError):
            _write(path, np.ascontiguousarray(depth, dtype="<u2").tobytes())
        return depth

    def colour(self, index: int) -> npt.NDArray[np.uint8] | None:
        return self._sequence.colour(index)

    @property
    def sha256(self) -> str:
        return self._sequence.sha256


def _read(path: Path, height: int, width: int) -> npt.NDArray[np.uint16] | None:
    """The depth (height, width) in PATH; None without a whole file."""
    try:
        content = path.read_bytes()
    except OSError:
        return None
    depth, check = content[:-CHECK_BYTES], content[-CHECK_BYTES:]
    if len(depth) != 2 * height * width or check != zlib.crc32(depth).to_bytes(CHECK_BYTES, "little"):
        return None
    return np.frombuffer(depth, dtype="<u2").reshape(height, width).astype(np.uint16)


def _write(path: Path, depth: bytes) -> None:
    """Write DEPTH and its CRC-32 at once: a reader finds the whole file or none."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(f".{os.getpid()}")
    try:
        part.write_bytes(depth + zlib.crc32(depth).to_bytes(CHECK_BYTES, "little"))
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
