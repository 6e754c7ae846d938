"""The layout of the normal equations that kernels sum over an image."""

from __future__ import annotations

from slam.layout import Layout

SUMS = 32  # floats of a record, what one work-group leaves behind; `least_squares.h` has the same
GROUP = 64  # work-items of a group in the layout by pixels; `least_squares.h` has the same
MOST_GROUPS = 128


def records_of(layout: Layout, width: int, height: int) -> tuple[int, tuple[int, ...], tuple[int, ...]]:
    """How many records a summing kernel leaves for an image, and its global and local size."""
    if not layout.pixels:
        return height, (height,), (1,)
    groups = min(MOST_GROUPS, -(-width * height // GROUP))
    return groups, (groups * GROUP,), (GROUP,)
