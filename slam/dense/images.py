"""Images on the device, and the cameras of the levels of a pyramid."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from slam.camera import Camera
from slam.devices.opencl import Session

if TYPE_CHECKING:
    from slam.devices.opencl import Buffer

SOURCE = Path(__file__).parent / "kernels" / "images.cl"


@dataclass(frozen=True)
class Vector3Image:
    """Three float32 images of one size: the x, y and z of a vector at each pixel."""

    x: Buffer
    y: Buffer
    z: Buffer

    @classmethod
    def allocate(cls, session: Session, pixels: int) -> Vector3Image:
        return cls(*(session.buffer(4 * pixels, "an image") for _ in range(3)))

    def __iter__(self):  # type: ignore[no-untyped-def]
        return iter((self.x, self.y, self.z))


@dataclass(frozen=True)
class Level:
    """One level of the pyramid: its camera, filtered depth in metres and normals in the camera's frame."""

    camera: Camera
    depth: Buffer
    normals: Vector3Image

    @classmethod
    def allocate(cls, session: Session, camera: Camera) -> Level:
        pixels = camera.width * camera.height
        return cls(camera, session.buffer(4 * pixels, "an image"), Vector3Image.allocate(session, pixels))


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


def cameras_of(camera: Camera, levels: int) -> list[Camera]:
    """The cameras of a pyramid, finest first."""
    cameras = [camera]
    while len(cameras) < levels:
        cameras.append(halved(cameras[-1]))
    return cameras


def intrinsics(camera: Camera) -> NDArray[np.float32]:
    """(fx, fy, cx, cy) as an OpenCL float4."""
    return np.array([camera.fx, camera.fy, camera.cx, camera.cy], np.float32)
