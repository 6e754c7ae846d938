"""Times of a run in one database field: uint32 little-endian microseconds, 400 bytes for 100 frames."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

TYPE = np.dtype("<u4")
LARGEST = int(np.iinfo(TYPE).max)
LOST, TRACKED, NEITHER = 0, 1, 2


def pack(microseconds: Sequence[int]) -> bytes:
    """The series of Python integers as bytes. OverflowError for one outside of 0..LARGEST (71 minutes)."""
    return np.array(microseconds, dtype=TYPE).tobytes()


def unpack(packed: bytes | memoryview) -> NDArray[np.uint32]:
    """The series (n,) of microseconds, read-only."""
    return np.frombuffer(packed, dtype=TYPE)


def unpack_many(packed: Sequence[bytes | memoryview]) -> NDArray[np.uint32]:
    """Series of one length as rows, (len(packed), n), read-only. Of one series or more."""
    return np.frombuffer(b"".join(packed), dtype=TYPE).reshape(len(packed), len(packed[0]) // TYPE.itemsize)


def seconds(microseconds: NDArray[np.uint32]) -> NDArray[np.float64]:
    """The same series in seconds."""
    return microseconds.astype(np.float64) * 1e-6


def pack_stages(stages: Mapping[str, Sequence[int]]) -> tuple[list[str], bytes]:
    """Stage names in their given order, and their series one after another."""
    return list(stages), b"".join(pack(series) for series in stages.values())


def unpack_stages(names: Sequence[str], packed: bytes | memoryview) -> dict[str, NDArray[np.uint32]]:
    """Each stage's series (n,); all are equally long. Empty where the run has no stages."""
    if not names:
        return {}
    series = unpack(packed).reshape(len(names), -1)
    return dict(zip(names, series, strict=True))


def pack_tracked(tracked: Sequence[bool | None]) -> bytes:
    """One byte a frame: TRACKED, LOST, or NEITHER for a frame whose tracking was skipped."""
    return bytes(NEITHER if flag is None else TRACKED if flag else LOST for flag in tracked)


def unpack_tracked(packed: bytes | memoryview) -> list[bool | None]:
    """True tracked, False lost, None neither; empty where the client did not tell."""
    return [None if code == NEITHER else code == TRACKED for code in bytes(packed)]
