"""Which points of a large plot are drawn: beyond MOST_DRAWN a browser becomes slow.

A plot of which points are left out says so: `said`.
"""

import math
from collections.abc import Callable, Sequence
from typing import TypeVar

MOST_DRAWN = 5000

T = TypeVar("T")


def decimated(points: Sequence[T], kept: Callable[[T], object], most: int = MOST_DRAWN) -> list[T]:
    """All of POINTS that are KEPT and at most MOST of the others, every n-th, in their order.

    Not random ones, and not the first: so that nearly the same points are drawn when one more has come.
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


def said(drawn: int, of: int) -> str:
    """What the plot says of it; empty where every point is drawn."""
    return f"{drawn:,} of {of:,} points drawn" if drawn < of else ""
