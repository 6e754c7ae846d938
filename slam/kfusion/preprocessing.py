"""Depth in millimetres to the filtered pyramid that tracking reads."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from slam.camera import Camera
from slam.dense import images
from slam.dense.images import Level, cameras_of, intrinsics
from slam.kfusion import configuration as constants
from slam.opencl import BoundKernel, Session

if TYPE_CHECKING:
    import pyopencl as cl

SOURCE = Path(__file__).parent / "kernels" / "preprocessing.cl"
FARTHEST_MEASURED = 65535  # millimetres that 16 bits can say


class Preprocessing:
    """Uploads a depth image, samples and filters it, and builds the levels that tracking asks for.

    `depth` holds the unfiltered metres at computation size, which integration reads.
    """

    def __init__(self, session: Session, sensor: Camera, ratio: int, levels: int, state: cl.Buffer) -> None:
        self._session = session
        cameras = cameras_of(sensor.scaled(ratio), levels)
        width, height = cameras[0].width, cameras[0].height
        self._millimetres = session.buffer(2 * sensor.width * sensor.height, "a depth image")
        self.depth = session.buffer(4 * width * height, "an image")
        farthest = session.buffer(4 * height, "a column")
        self.levels = [Level.allocate(session, camera) for camera in cameras]
        finest = self.levels[0]
        self._sample: list[BoundKernel] = [
            session.image_kernel(
                images.SOURCE, "millimetres_to_metres", width, height, self._millimetres, sensor.width,
                ratio, 0, FARTHEST_MEASURED, self.depth, width, height,
            ),
            session.kernel(SOURCE, "farthest_of_rows", (height,), self.depth, width, farthest),
            session.kernel(SOURCE, "farthest_depth", (1,), farthest, height, state),
            session.image_kernel(
                images.SOURCE, "bilateral_filter", width, height, self.depth, finest.depth, width, height,
                0.5 / constants.BILATERAL_SPATIAL_SIGMA**2, 0.5 / constants.BILATERAL_RANGE_SIGMA**2,
            ),
        ]  # fmt: skip
        self._build: list[BoundKernel] = []
        for fine, coarse in zip(self.levels, self.levels[1:], strict=False):
            width, height = coarse.camera.width, coarse.camera.height
            self._build.append(
                session.image_kernel(
                    images.SOURCE, "half_sample", width, height, fine.depth, fine.camera.width,
                    coarse.depth, width, height, constants.HALF_SAMPLE_RANGE,
                )
            )  # fmt: skip
        for level in self.levels:
            width, height = level.camera.width, level.camera.height
            self._build.append(
                session.image_kernel(
                    images.SOURCE, "normal_map", width, height, level.depth, *level.normals, width, height,
                    intrinsics(level.camera),
                )
            )  # fmt: skip

    def filter(self, depth: NDArray[np.uint16]) -> None:
        """Upload (height, width) millimetres, sample every ratio-th pixel and filter into level 0."""
        import pyopencl as cl

        cl.enqueue_copy(self._session.queue, self._millimetres, depth, is_blocking=False)
        for kernel in self._sample:
            kernel()

    def build_pyramid(self) -> None:
        """The coarser levels and the normals of all of them; only needed where tracking runs."""
        for kernel in self._build:
            kernel()
