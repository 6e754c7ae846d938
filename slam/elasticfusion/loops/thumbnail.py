"""Small images on the host, for ferns and keyframes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from slam.camera import Camera
from slam.devices.opencl import Session
from slam.elasticfusion.images import RgbdImage

SOURCE = Path(__file__).parents[1] / "kernels" / "fill_in.cl"


@dataclass(frozen=True)
class Thumbnail:
    """An RgbdImage on the host: depth (h, w) in metres, normals (h, w, 3) in the camera's frame, and colour
    (h, w) as r | g << 8 | b << 16; all 0 where there is none.
    """

    camera: Camera
    depth: NDArray[np.float32]
    normals: NDArray[np.float32]
    colour: NDArray[np.uint32]

    @property
    def vertices(self) -> NDArray[np.float32]:
        """The points (h, w, 3) in the camera's frame; 0 where there is no depth."""
        camera = self.camera
        y, x = np.mgrid[: camera.height, : camera.width].astype(np.float32)
        rays = np.dstack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones_like(x)])
        return np.asarray(rays * self.depth[..., None], np.float32)


def sampled(camera: Camera, ratio: int) -> Camera:
    """The camera of the pixels in the middle of each block of ratio x ratio; incomplete ones are left out."""
    middle = ratio // 2
    return Camera(
        camera.fx / ratio,
        camera.fy / ratio,
        (camera.cx - middle) / ratio,
        (camera.cy - middle) / ratio,
        camera.width // ratio,
        camera.height // ratio,
    )


def read(session: Session, image: RgbdImage) -> Thumbnail:
    """The current image on the device; waits for it."""
    shape = (image.camera.height, image.camera.width)
    planes = np.empty((4, *shape), np.float32)
    colour = np.empty(shape, np.uint32)
    for plane, buffer in zip(planes, (image.depth, *image.normals), strict=True):
        session.download(buffer, plane)
    session.download(image.colour, colour)
    return Thumbnail(image.camera, planes[0], np.moveaxis(planes[1:], 0, -1), colour)


def write(session: Session, image: RgbdImage, thumbnail: Thumbnail) -> None:
    """Put a thumbnail back onto the device, into an image of its size, for instance to register with it."""
    if (image.camera.width, image.camera.height) != (thumbnail.camera.width, thumbnail.camera.height):
        raise ValueError(
            f"a thumbnail of {thumbnail.camera.width}x{thumbnail.camera.height} pixels does not fit "
            f"an image of {image.camera.width}x{image.camera.height}"
        )
    session.upload(image.depth, thumbnail.depth)
    session.upload(image.colour, thumbnail.colour)
    for axis, buffer in enumerate(image.normals):
        session.upload(buffer, thumbnail.normals[..., axis])


class Sampling:
    """`image`: every `ratio`-th pixel of another image, each from the middle of its block."""

    def __init__(self, session: Session, image: RgbdImage, ratio: int) -> None:
        camera = sampled(image.camera, ratio)
        self.image = RgbdImage.allocate(session, camera)
        self._session = session
        small = self.image
        self._sample = session.image_kernel(
            SOURCE, "sample_image", camera.width, camera.height, image.depth, *image.normals, image.colour,
            image.camera.width, ratio, small.depth, *small.normals, small.colour, camera.width, camera.height,
        )  # fmt: skip

    def read(self) -> Thumbnail:
        """Sample the current image; waits for the device."""
        self._sample()
        return read(self._session, self.image)
