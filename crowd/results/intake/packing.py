"""Packs the times of a run into one database field: microseconds as little-endian uint32."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

DTYPE = np.dtype("<u4")
MAX_MICROSECONDS = int(np.iinfo(DTYPE).max)
LOST, TRACKED, NEITHER = 0, 1, 2


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
