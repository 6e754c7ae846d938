"""Packs what a run measured in each frame into one database field.

A series of times is microseconds as little-endian uint32. `compress` joins the series of a run and makes them
smaller, without loss.
"""

import struct
import zlib
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

DTYPE = np.dtype("<u4")
MAX_MICROSECONDS = int(np.iinfo(DTYPE).max)
LOST, TRACKED, NEITHER = 0, 1, 2
# Of compressed series. Neither the header nor the names may change: what is stored depends on both.
FORMAT = 1
HEADER = struct.Struct("<IH")  # frames, bytes of the names
COMMON_NAMES = b"acquisition,preprocessing,tracking,integration,raycasting,rendering"


class Series(NamedTuple):
    """What a run measured in each frame.

    `frame_us` is a packed series. `stages_us` has one for each of `stages`, one after another. `tracked` is
    as `pack_tracked` returns it.
    """

    frame_us: bytes
    stages: list[str]
    stages_us: bytes
    tracked: bytes

    @property
    def size(self) -> int:
        """Bytes of the packed series."""
        return len(self.frame_us) + len(self.stages_us) + len(self.tracked)


def compress(series: Series) -> bytes:
    """`series` as stored: the first bytes of all times, then all second ones and so on, compressed.

    Instead of a frame's time, the part of it outside of all stages is stored, which is small: modulo 2**32,
    so that nothing is lost if the stages take longer than the frame.
    """
    frames, names = unpack(series.frame_us), ",".join(series.stages).encode()
    stages = unpack(series.stages_us).reshape(len(series.stages), len(frames))
    times = np.concatenate([frames - stages.sum(axis=0, dtype=np.uint32), stages.ravel()])
    planes = times.astype(DTYPE).view(np.uint8).reshape(-1, DTYPE.itemsize).T
    stream = zlib.compressobj(zlib.Z_BEST_COMPRESSION, zdict=COMMON_NAMES)
    content = HEADER.pack(len(frames), len(names)) + names + planes.tobytes() + series.tracked
    return bytes([FORMAT]) + stream.compress(content) + stream.flush()


def decompress(stored: bytes | memoryview) -> Series:
    """The series of `stored`. Raises ValueError for another format and if its end is missing, zlib.error for
    damaged content.
    """
    if stored[0] != FORMAT:
        raise ValueError(f"format {stored[0]} of a run's series: this version reads {FORMAT}")
    stream = zlib.decompressobj(zdict=COMMON_NAMES)
    content = stream.decompress(stored[1:])
    if not stream.eof:
        raise ValueError(f"{len(stored)} bytes of a run's series: the rest is missing")
    frames, length = HEADER.unpack_from(content)
    begin = HEADER.size + length
    names = content[HEADER.size : begin].decode()
    stages = names.split(",") if names else []
    end = begin + DTYPE.itemsize * frames * (1 + len(stages))
    planes = np.frombuffer(content[begin:end], np.uint8).reshape(DTYPE.itemsize, -1)
    times = np.ascontiguousarray(planes.T).view(DTYPE).reshape(1 + len(stages), frames)
    total = times.sum(axis=0, dtype=np.uint32).astype(DTYPE)
    return Series(total.tobytes(), stages, times[1:].tobytes(), content[end:])


def pack(microseconds: Sequence[int]) -> bytes:
    """A series of integers as bytes. Raises OverflowError outside 0..MAX_MICROSECONDS (71 minutes)."""
    return np.array(microseconds, dtype=DTYPE).tobytes()


def unpack(packed: bytes | memoryview) -> NDArray[np.uint32]:
    """The series (n,) of microseconds, read-only."""
    return np.frombuffer(packed, dtype=DTYPE)


def unpack_many(packed: Sequence[bytes | memoryview]) -> NDArray[np.uint32]:
    """One or more series of equal length as rows, (len(packed), n), read-only."""
    return np.frombuffer(b"".join(packed), dtype=DTYPE).reshape(len(packed), len(packed[0]) // DTYPE.itemsize)


def seconds(microseconds: NDArray[np.uint32]) -> NDArray[np.float64]:
    """`microseconds` in seconds."""
    return microseconds.astype(np.float64) * 1e-6


def pack_stages(stages: Mapping[str, Sequence[int]]) -> tuple[list[str], bytes]:
    """The names of `stages` in order, and their series one after another."""
    return list(stages), b"".join(pack(series) for series in stages.values())


def unpack_stages(names: Sequence[str], packed: bytes | memoryview) -> dict[str, NDArray[np.uint32]]:
    """The series (n,) of each stage, all of equal length. Empty if the run has no stages."""
    if not names:
        return {}
    series = unpack(packed).reshape(len(names), -1)
    return dict(zip(names, series, strict=True))


def pack_tracked(tracked: Sequence[bool | None]) -> bytes:
    """One byte a frame: `tracked`, LOST, or NEITHER for a frame whose tracking was skipped."""
    return bytes(NEITHER if flag is None else TRACKED if flag else LOST for flag in tracked)


def unpack_tracked(packed: bytes | memoryview) -> list[bool | None]:
    """True: tracked, False: lost, None: tracking was skipped. Empty if the client did not report it."""
    return [None if code == NEITHER else code == TRACKED for code in bytes(packed)]
