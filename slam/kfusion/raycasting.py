"""The model as the camera last saw it: surface points and normals found by marching rays."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from slam.camera import Camera
from slam.dense.images import Planes, intrinsics
from slam.kfusion import configuration as constants
from slam.kfusion.volume import NEAR_SURFACE, Volume
from slam.opencl import Session

if TYPE_CHECKING:
    import pyopencl as cl

SOURCE = Path(__file__).parent / "kernels" / "raycasting.cl"


class Model:
    """Vertex and normal maps in the volume's frame; both are zero where a ray found no surface."""

    def __init__(self, session: Session, volume: Volume, camera: Camera, mu: float, state: cl.Buffer) -> None:
        self.camera = camera
        self._session = session
        pixels = camera.width * camera.height
        self.vertices = Planes.allocate(session, pixels)
        self.normals = Planes.allocate(session, pixels)
        self._kernels = [
            session.kernel(SOURCE, "view_from", (1,), intrinsics(camera), state),
            session.image_kernel(
                SOURCE, "raycast", camera.width, camera.height, volume.voxels, volume.resolution,
                volume.voxel_size, volume.searched, volume.blocks, camera.width, camera.height,
                intrinsics(camera), constants.NEAR_PLANE, constants.FAR_PLANE,
                volume.voxel_size, 0.75 * mu, NEAR_SURFACE, state,
                *self.vertices, *self.normals,
            ),
        ]  # fmt: skip

    def raycast(self) -> None:
        """Look at the volume from the present pose."""
        for kernel in self._kernels:
            kernel()

    def read(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """The vertex and the normal map of the last raycast, both (height, width, 3)."""
        import pyopencl as cl

        maps = np.empty((2, 3, self.camera.height, self.camera.width), np.float32)
        for image, plane in zip(maps.reshape(6, -1), (*self.vertices, *self.normals), strict=True):
            cl.enqueue_copy(self._session.queue, image, plane)
        vertices, normals = np.moveaxis(maps, 1, -1)
        return vertices, normals
