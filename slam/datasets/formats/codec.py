"""Lossless compression of depth images that decodes in a few vectorised passes.

Depth cameras deliver few distinct values (a Kinect some 300 to 800), so a chunk keeps its sorted values once
and frames hold ranks in that palette: the steps from pixel to pixel are then mostly 0 or 1. Steps are taken
along the flattened image, folded to non-negative numbers (0, -1, 1, -2, ... become 0, 1, 2, 3, ...), split
into a plane of low and one of high bytes, and deflated.

A chunk, little-endian: u32 palette size, u16 palette, then for every frame u32 size and that many bytes.

Why not the median-edge predictor of JPEG-LS: it can only be undone pixel by pixel, and it saves nothing on
ranks of Kinect depth: 58 KB a frame against 60 on a real recording, 71 against 63 on noisy synthetic depth,
both deflated. A running sum undoes plain steps in one NumPy call.
"""

from __future__ import annotations

import struct
import zlib

import numpy as np
import numpy.typing as npt

from slam.datasets.sequence import SequenceError

_COUNT = struct.Struct("<I")


def encode(frames: list[npt.NDArray[np.uint16]]) -> bytes:
    """The chunk of some depth images of one size."""
    palette = np.unique(np.concatenate([frame.ravel() for frame in frames]))
    parts = [_COUNT.pack(len(palette)), palette.astype("<u2").tobytes()]
    for frame in frames:
        ranks = np.searchsorted(palette, frame.ravel()).astype(np.uint16)
        steps = np.diff(ranks, prepend=np.uint16(0)).view(np.int16)
        folded = ((steps << 1) ^ (steps >> 15)).view(np.uint16)
        planes = (folded & 0xFF).astype(np.uint8).tobytes() + (folded >> 8).astype(np.uint8).tobytes()
        data = zlib.compress(planes, 9)
        parts += [_COUNT.pack(len(data)), data]
    return b"".join(parts)


def decode(chunk: bytes, index: int, width: int, height: int) -> npt.NDArray[np.uint16]:
    """Frame `index` of a chunk, uint16 (height, width). Raises SequenceError when the chunk is damaged."""
    try:
        (size,) = _COUNT.unpack_from(chunk, 0)
        palette = np.frombuffer(chunk, "<u2", size, _COUNT.size).astype(np.uint16)
        data = part(chunk, index, _COUNT.size + 2 * size)
        # Inflating one byte more than expected detects a frame that is too long.
        planes = zlib.decompressobj().decompress(data, 2 * width * height + 1)
        low, high = np.frombuffer(planes, np.uint8).reshape(2, height * width)
        folded = low | (high.astype(np.uint16) << 8)
        steps = (folded >> 1) ^ (-(folded & 1).view(np.int16)).view(np.uint16)
        ranks = np.cumsum(steps, dtype=np.uint16)
        return palette[ranks].reshape(height, width)
    except SequenceError:
        raise
    except (struct.error, zlib.error, ValueError, IndexError) as error:
        raise SequenceError(f"frame {index} of a chunk of {len(chunk)} bytes is damaged: {error}") from None


def join(parts: list[bytes]) -> bytes:
    """A chunk of already compressed frames, such as JPEG images: u32 size and bytes of each."""
    return b"".join(_COUNT.pack(len(data)) + data for data in parts)


def part(chunk: bytes, index: int, begin: int = 0) -> bytes:
    """The bytes of frame `index`, whose sizes are in the chunk from `begin` on.

    Raises SequenceError when the chunk ends before the frame does.
    """
    try:
        for _ in range(index):
            begin += _COUNT.size + _COUNT.unpack_from(chunk, begin)[0]
        (size,) = _COUNT.unpack_from(chunk, begin)
    except struct.error:
        raise SequenceError(f"a chunk of {len(chunk)} bytes ends before its frame {index}") from None
    data = chunk[begin + _COUNT.size : begin + _COUNT.size + size]
    if len(data) != size:
        raise SequenceError(f"frame {index} of a chunk is cut short: {len(data)} of {size} bytes")
    return data
