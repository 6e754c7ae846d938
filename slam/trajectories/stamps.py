"""Stamps of frames and poses, as people and programs write them."""

from __future__ import annotations

LARGEST_STAMP = 1e12  # seconds: beyond lies damage
NANOSECONDS = (1e17, 1e19)  # since 1970 this is 1973 to 2286, as ROS and EuRoC write stamps


def is_nanoseconds(stamp: float) -> bool:
    return NANOSECONDS[0] <= stamp < NANOSECONDS[1]


def in_seconds(stamp: float) -> float | None:
    """A stamp in seconds or in nanoseconds since 1970, as seconds; None for a number that is neither."""
    if is_nanoseconds(stamp):
        return stamp / 1e9
    return stamp if abs(stamp) <= LARGEST_STAMP else None


def read_stamp(text: str) -> float | None:
    """The seconds of a stamp; None for text that is not one."""
    try:
        return in_seconds(float(text))
    except ValueError:
        return None
