"""The pinhole camera of a sequence."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Camera:
    """Intrinsics in pixels; pixel (u, v) at depth z sees the point ((u - cx) z / fx, (v - cy) z / fy, z).

    Axes are OpenCV's (x right, y down, z forward) and integer pixel coordinates lie at pixel centres.
    A negative `fy` is allowed: ICL-NUIM's official files mirror y.

    Raises ValueError when a focal length is zero or not finite, or the size is not positive.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int

    def __post_init__(self) -> None:
        for name in ("fx", "fy", "cx", "cy"):
            if not math.isfinite(getattr(self, name)):
                raise ValueError(f"camera {name}={getattr(self, name)} must be a finite number of pixels")
        for name in ("fx", "fy"):
            if getattr(self, name) == 0:
                raise ValueError(f"camera {name}=0 has no field of view: give the focal length in pixels")
        if self.width < 1 or self.height < 1:
            raise ValueError(f"camera size {self.width}x{self.height} must be at least 1x1 pixel")

    def scaled(self, ratio: int) -> Camera:
        """The camera of an image that keeps every `ratio`-th pixel of each row and column.

        All four intrinsics are divided by `ratio`, as SLAMBench does for its compute size ratio.
        Raises ValueError when `ratio` does not divide width and height.
        """
        if ratio < 1 or self.width % ratio or self.height % ratio:
            raise ValueError(f"ratio {ratio} must be a positive divisor of {self.width}x{self.height}")
        return Camera(
            self.fx / ratio,
            self.fy / ratio,
            self.cx / ratio,
            self.cy / ratio,
            self.width // ratio,
            self.height // ratio,
        )
