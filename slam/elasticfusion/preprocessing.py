"""A sensor's depth and colour, as the image that everything else reads."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from slam.camera import Camera
from slam.dense import images
from slam.dense.images import intrinsics
from slam.devices.opencl import Session
from slam.elasticfusion.configuration import NEAREST
from slam.elasticfusion.images import RgbdImage

if TYPE_CHECKING:
    from slam.devices.opencl import Buffer

SOURCE = Path(__file__).parent / "kernels" / "preprocessing.cl"
RADIUS = 6  # pixels of the bilateral filter: 13 along rows, then 13 along columns
SPATIAL_SIGMA = 4.5  # pixels
RANGE_SIGMA = 0.03  # metres


class InputFrame:
    """The current frame of the camera.

    image: every `ratio`-th pixel of what `sensor` measured, across and down: depth as measured, 0 beyond
    `depth_cutoff` and nearer than 0.3 m; normals of the filtered depth; the colours. filtered: float32 metres
    (height, width), the depth smoothed (bilateral, 13 pixels along rows and then along columns).

    The map is made of measured depth, so the measured depth is registered to it. The filter rounds creases
    and rims: tracking by filtered depth drifts there, by 1 to 2 mm a frame in a small room.
    """

    def __init__(self, session: Session, sensor: Camera, depth_cutoff: float, ratio: int = 1) -> None:
        self._session = session
        camera = sensor.scaled(ratio)
        width, height = camera.width, camera.height
        pixels = width * height
        self._millimetres = session.buffer(2 * sensor.width * sensor.height, "a depth image")
        self._bytes = session.buffer(3 * sensor.width * sensor.height, "a colour image")
        self.filtered: Buffer = session.buffer(4 * pixels, "an image")
        self.image = RgbdImage.allocate(session, camera)
        image = self.image
        along_rows = session.buffer(4 * pixels, "an image")
        self._kernels = [
            session.image_kernel(
                images.SOURCE, "millimetres_to_metres", width, height, self._millimetres,
                sensor.width, ratio, round(1000 * NEAREST), round(1000 * depth_cutoff), image.depth, width,
                height,
            ),
            *(
                session.image_kernel(
                    images.SOURCE, "bilateral_filter_line", width, height, source, target, width, height,
                    down, RADIUS, 0.5 / SPATIAL_SIGMA**2, 0.5 / RANGE_SIGMA**2,
                )
                for source, target, down in ((image.depth, along_rows, 0), (along_rows, self.filtered, 1))
            ),
            session.image_kernel(
                images.SOURCE, "normal_map", width, height, self.filtered, *image.normals, width, height,
                intrinsics(camera),
            ),
            session.image_kernel(
                SOURCE, "pack_colour", width, height, self._bytes, sensor.width, ratio, image.colour, width,
                height,
            ),
        ]  # fmt: skip

    def take(self, depth: NDArray[np.uint16], colour: NDArray[np.uint8]) -> None:
        """Enqueue the sensor's depth (height, width) in millimetres, colour (height, width, 3), red first.

        Both must stay unchanged until the session has finished with them.
        """
        self._session.upload(self._millimetres, depth, wait=False)
        self._session.upload(self._bytes, colour, wait=False)
        for kernel in self._kernels:
            kernel()
