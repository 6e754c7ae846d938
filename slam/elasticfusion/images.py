"""An RGB-D image on the device: what a camera measures, and likewise what it would see of the map."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from slam.camera import Camera
from slam.dense.images import Vector3Image
from slam.devices.opencl import Session

if TYPE_CHECKING:
    from slam.devices.opencl import Buffer


@dataclass(frozen=True)
class RgbdImage:
    """Depth, normals and colour of each pixel of a camera, row by row.

    depth: float32 metres along the optical axis, 0 where there is none. normals: of unit length, towards the
    camera and in its frame, (0, 0, 0) where there is none. colour: uint32, red | green << 8 | blue << 16, 0
    where there is none; black is stored as (1, 1, 1).
    """

    camera: Camera
    depth: Buffer
    normals: Vector3Image
    colour: Buffer

    @classmethod
    def allocate(cls, session: Session, camera: Camera) -> RgbdImage:
        pixels = camera.width * camera.height
        depth, colour = (session.buffer(4 * pixels, "an image") for _ in range(2))
        return cls(camera, depth, Vector3Image.allocate(session, pixels), colour)
