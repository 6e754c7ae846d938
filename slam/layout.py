"""How kernels over an image are laid out on a device."""

from __future__ import annotations

import os
from dataclasses import dataclass

KINDS = ("rows", "pixels")


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

    def over(self, width: int, height: int) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Global and local size of a kernel over an image; groups at the sides may stand out of it."""
        if not self.pixels:
            return (height,), (1,)
        columns, rows = self.group
        return (-(-width // columns) * columns, -(-height // rows) * rows), self.group
