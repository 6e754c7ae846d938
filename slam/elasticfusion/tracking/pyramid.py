"""An RGB-D image at full, half and quarter size, as a registration reads it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from slam.camera import Camera
from slam.dense import images
from slam.dense.images import Vector3Image, cameras_of
from slam.devices.opencl import BoundKernel, Session
from slam.elasticfusion.configuration import LEVELS
from slam.elasticfusion.images import RgbdImage

if TYPE_CHECKING:
    from slam.devices.opencl import Buffer

SOURCE = Path(__file__).parents[1] / "kernels" / "pyramid.cl"
HALF_SAMPLE_RANGE = 0.09  # metres: what differs more is another surface


@dataclass(frozen=True)
class PyramidLevel:
    """One size of an image; all float32 (height, width).

    depth: metres, 0 where none. normals: unit, towards the camera, (0, 0, 0) where none. intensity: 0 to 255,
    0 where none. gradient_x, gradient_y: intensity per pixel to the right and down, 0 beside missing ones.
    """

    camera: Camera
    depth: Buffer
    normals: Vector3Image
    intensity: Buffer
    gradient_x: Buffer
    gradient_y: Buffer


class Pyramid:
    """`levels` of an image, finest first; depth and normals of the finest are the image's own.

    A coarse pixel is the mean of a 2x2 block, of what belongs to the surface of its first pixel.
    """

    def __init__(self, session: Session, image: RgbdImage, levels: int = LEVELS) -> None:
        self.levels = [
            _allocated(session, camera, image if size == 0 else None)
            for size, camera in enumerate(cameras_of(image.camera, levels))
        ]
        finest = self.levels[0]
        width, height = finest.camera.width, finest.camera.height
        self._kernels: list[BoundKernel] = [
            session.image_kernel(
                SOURCE, "intensity", width, height, image.colour, finest.intensity, width, height
            )
        ]
        for fine, coarse in zip(self.levels, self.levels[1:], strict=False):
            width, height, fine_width = coarse.camera.width, coarse.camera.height, fine.camera.width
            self._kernels += [
                session.image_kernel(
                    images.SOURCE, "half_sample", width, height, fine.depth, fine_width, coarse.depth,
                    width, height, HALF_SAMPLE_RANGE,
                ),
                session.image_kernel(
                    SOURCE, "half_sample_normals", width, height, fine.depth, *fine.normals, fine_width,
                    *coarse.normals, width, height, HALF_SAMPLE_RANGE,
                ),
                session.image_kernel(
                    SOURCE, "half_sample_intensity", width, height, fine.intensity, fine_width,
                    fine.camera.height, coarse.intensity, width, height,
                ),
            ]  # fmt: skip
        for level in self.levels:
            width, height = level.camera.width, level.camera.height
            self._kernels.append(
                session.image_kernel(
                    SOURCE, "gradient", width, height, level.intensity, level.gradient_x, level.gradient_y,
                    width, height,
                )
            )  # fmt: skip

    def build(self) -> None:
        """Enqueue all levels of what the image holds now."""
        for kernel in self._kernels:
            kernel()


def _allocated(session: Session, camera: Camera, image: RgbdImage | None) -> PyramidLevel:
    """A level's memory; depth and normals are those of `image` where it is given."""
    pixels = camera.width * camera.height
    intensity, gradient_x, gradient_y = (session.buffer(4 * pixels, "an image") for _ in range(3))
    depth = image.depth if image else session.buffer(4 * pixels, "an image")
    normals = image.normals if image else Vector3Image.allocate(session, pixels)
    return PyramidLevel(camera, depth, normals, intensity, gradient_x, gradient_y)
