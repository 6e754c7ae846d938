"""Depth in millimetres to the filtered pyramid that tracking reads."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from slam.camera import Camera
from slam.kfusion import configuration as constants
from slam.opencl import BoundKernel, Session

if TYPE_CHECKING:
    import pyopencl as cl

SOURCE = Path(__file__).parent / "kernels" / "preprocessing.cl"


@dataclass(frozen=True)
class Planes:
    """Three float32 images of one size: the x, y and z of a vector at each pixel."""

    x: cl.Buffer
    y: cl.Buffer
    z: cl.Buffer

    @classmethod
    def allocate(cls, session: Session, pixels: int) -> Planes:
        return cls(*(session.buffer(4 * pixels, "an image") for _ in range(3)))

    def __iter__(self):  # type: ignore[no-untyped-def]
        return iter((self.x, self.y, self.z))


@dataclass(frozen=True)
class Level:
    """One level of the pyramid: its camera, filtered depth in metres and normals in the camera's frame."""

    camera: Camera
    depth: cl.Buffer
    normals: Planes


def halved(camera: Camera) -> Camera:
    """The camera of a half-sampled image; an odd row or column is left out.

    A coarse pixel stands for a 2x2 block, whose middle lies half a fine pixel beyond its first pixel.
    SLAMBench halves the principal point without that shift, which moves the coarse levels' answer.
    """
    return Camera(
        camera.fx / 2,
        camera.fy / 2,
        (camera.cx - 0.5) / 2,
        (camera.cy - 0.5) / 2,
        camera.width // 2,
        camera.height // 2,
    )


def intrinsics(camera: Camera) -> NDArray[np.float32]:
    """(fx, fy, cx, cy) as an OpenCL float4."""
    return np.array([camera.fx, camera.fy, camera.cx, camera.cy], np.float32)


class Preprocessing:
    """Uploads a depth image, samples and filters it, and builds the levels that tracking asks for.

    `depth` holds the unfiltered metres at computation size, which integration reads.
    """

    def __init__(self, session: Session, sensor: Camera, ratio: int, levels: int, state: cl.Buffer) -> None:
        self._session = session
        camera = sensor.scaled(ratio)
        width, height = camera.width, camera.height
        pixels = camera.width * camera.height
        self._millimetres = session.buffer(2 * sensor.width * sensor.height, "a depth image")
        self.depth = session.buffer(4 * pixels, "an image")
        farthest = session.buffer(4 * camera.height, "a column")

        self.levels: list[Level] = []
        for _ in range(levels):
            size = camera.width * camera.height
            buffer = session.buffer(4 * size, "an image")
            self.levels.append(Level(camera, buffer, Planes.allocate(session, size)))
            camera = halved(camera)

        finest = self.levels[0]
        self._sample: list[BoundKernel] = [
            session.image_kernel(
                SOURCE, "millimetres_to_metres", width, height, self._millimetres, sensor.width, ratio,
                self.depth, width, height,
            ),
            session.kernel(SOURCE, "farthest_of_rows", (height,), self.depth, width, farthest),
            session.kernel(SOURCE, "farthest_depth", (1,), farthest, height, state),
            session.image_kernel(
                SOURCE, "bilateral_filter", width, height, self.depth, finest.depth, width, height,
                0.5 / constants.BILATERAL_SPATIAL_SIGMA**2, 0.5 / constants.BILATERAL_RANGE_SIGMA**2,
            ),
        ]  # fmt: skip
        self._build: list[BoundKernel] = []
        for fine, coarse in zip(self.levels, self.levels[1:], strict=False):
            width, height = coarse.camera.width, coarse.camera.height
            self._build.append(
                session.image_kernel(
                    SOURCE, "half_sample", width, height, fine.depth, fine.camera.width, coarse.depth,
                    width, height, constants.HALF_SAMPLE_RANGE,
                )
            )  # fmt: skip
        for level in self.levels:
            width, height = level.camera.width, level.camera.height
            self._build.append(
                session.image_kernel(
                    SOURCE, "normal_map", width, height, level.depth, *level.normals, width, height,
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
