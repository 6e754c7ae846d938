"""The layout of kernels over an image on a device."""

from __future__ import annotations

import os
from dataclasses import dataclass

KINDS = ("rows", "pixels")
SUMS = 32  # floats of a record: the part of the normal equations that one work-group leaves behind
SUM_GROUP = 64  # work-items of a group that sums, by pixels
MOST_SUM_GROUPS = 512
SOLVERS = 64  # work-items of the group that adds up the records, by pixels: 2 for each float of one


@dataclass(frozen=True)
class Layout:
    """kind "rows": one work-item walks an image row, as CPUs want it; "pixels": one work-item per pixel in
    groups of `group` (width, height), as GPUs want it.
    """

    kind: str
    group: tuple[int, int] = (16, 8)

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f"kernel layout {self.kind!r}: choose one of {', '.join(KINDS)}")

    @classmethod
    def for_device(cls, kind: str) -> Layout:
        """Rows on CPUs, pixels elsewhere; FRONTRUNNER_KERNELS=rows or pixels overrides it."""
        return cls(os.environ.get("FRONTRUNNER_KERNELS") or ("rows" if kind == "cpu" else "pixels"))

    @property
    def pixels(self) -> bool:
        return self.kind == "pixels"

    def macros(self) -> dict[str, int]:
        """The macros that kernels need: the sizes of `slam.devices.layout`, and PIXELS for that kind."""
        return {"SUMS": SUMS, "SUM_GROUP": SUM_GROUP, "SOLVERS": SOLVERS} | (
            {"PIXELS": 1} if self.pixels else {}
        )

    def over(self, width: int, height: int) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Global and local size of a kernel over an image; groups at the sides may extend beyond it."""
        if not self.pixels:
            return (height,), (1,)
        columns, rows = self.group
        return (-(-width // columns) * columns, -(-height // rows) * rows), self.group

    def sums(self, width: int, height: int) -> tuple[int, tuple[int, ...], tuple[int, ...]]:
        """The number of records that a summing kernel writes for an image, and its global and local size."""
        if not self.pixels:
            return height, (height,), (1,)
        groups = min(MOST_SUM_GROUPS, -(-width * height // SUM_GROUP))
        return groups, (groups * SUM_GROUP,), (SUM_GROUP,)

    def lines(self, count: int) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Global and local size of a kernel with one work-item for each of `count` lines."""
        group = SUM_GROUP if self.pixels else 1
        return (-(-count // group) * group,), (group,)

    def blocks(self, blocks: int) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Global and local size of a kernel over `blocks`^3 blocks: by rows one work-item."""
        return self.over(blocks, blocks * blocks) if self.pixels else ((1,), (1,))

    def one_group(self, size: int) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Global and local size of a kernel that one group of `size` work-items does, by rows one
        work-item."""
        return ((size,), (size,)) if self.pixels else ((1,), (1,))
