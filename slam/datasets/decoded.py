"""A sequence whose depth is decoded once: later processes read the decoded frames from a folder."""

from __future__ import annotations

import contextlib
import os
import zlib
from pathlib import Path

import numpy as np
import numpy.typing as npt

from slam.datasets.sequence import DerivedSequence, Sequence

CHECK_BYTES = 4  # of the CRC-32 behind the depth


class Decoded(DerivedSequence):
    """`sequence` with its decoded depth kept below `folder`, a file for each frame.

    A file is written when its frame is first read. A damaged one is written again. Where `folder` cannot be
    written, each frame is decoded as without it. A frame takes 2 bytes a pixel: 100 frames of 640x480 take
    61 MB. Several processes may share a folder.
    """

    def __init__(self, sequence: Sequence, folder: Path) -> None:
        super().__init__(sequence)
        self._folder = folder / sequence.sha256

    def depth(self, index: int) -> npt.NDArray[np.uint16]:
        self.check_index(index)
        path = self._folder / f"{index}.depth"
        kept = _read(path, self.camera.height, self.camera.width)
        if kept is not None:
            return kept
        depth = self._source.depth(index)
        with contextlib.suppress(OSError):
            _write(path, np.ascontiguousarray(depth, dtype="<u2").tobytes())
        return depth


def _read(path: Path, height: int, width: int) -> npt.NDArray[np.uint16] | None:
    """The depth (height, width) in `path`; None without a whole file."""
    try:
        content = path.read_bytes()
    except OSError:
        return None
    depth, check = content[:-CHECK_BYTES], content[-CHECK_BYTES:]
    if len(depth) != 2 * height * width or check != zlib.crc32(depth).to_bytes(CHECK_BYTES, "little"):
        return None
    return np.frombuffer(depth, dtype="<u2").reshape(height, width).astype(np.uint16)


def _write(path: Path, depth: bytes) -> None:
    """Write `depth` and its CRC-32 at once: a reader finds the whole file or none."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(f".{os.getpid()}")
    try:
        part.write_bytes(depth + zlib.crc32(depth).to_bytes(CHECK_BYTES, "little"))
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
