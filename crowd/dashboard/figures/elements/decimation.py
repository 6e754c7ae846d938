"""Decimation of large plots: browsers become slow beyond MOST_DRAWN points."""

import math
from collections.abc import Callable, Sequence
from typing import TypeVar

MOST_DRAWN = 5000

T = TypeVar("T")


def decimate(points: Sequence[T], kept: Callable[[T], object], most: int = MOST_DRAWN) -> list[T]:
    """All `points` that are `kept`, and every n-th of the others, at most `most`, in order.

    Every n-th rather than random ones, so that a new point changes little.
    """
    if len(points) <= most:
        return list(points)
    drawn: list[T] = []
    every = math.ceil(sum(not kept(point) for point in points) / most)
    passed = 0
    for point in points:
        if kept(point):
            drawn.append(point)
            continue
        if passed % every == 0:
            drawn.append(point)
        passed += 1
    return drawn


def decimation_note(drawn: int, of: int) -> str:
    """The note about left-out points; empty if all are drawn."""
    return f"{drawn:,} of {of:,} points drawn" if drawn < of else ""
