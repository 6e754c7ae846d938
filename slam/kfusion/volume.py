"""The truncated signed distance function: fusing depth images."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from slam.camera import Camera
from slam.dense.images import intrinsics
from slam.kfusion import configuration as constants
from slam.layout import Layout
from slam.opencl import DeviceMemoryError, Session

if TYPE_CHECKING:
    import pyopencl as cl

SOURCE = Path(__file__).parent / "kernels" / "volume.cl"
SCALE = 32766  # of the stored 16-bit distance; `volume.cl` has the same
BLOCK = 8  # voxels along each side of a block; `volume.cl` has the same
NEAR_SURFACE = 0.8 * SCALE  # below it a ray takes small steps


def blocks_of(resolution: int) -> int:
    """Blocks along each side."""
    return -(-resolution // BLOCK)


def lines_of(layout: Layout, resolution: int) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Global and local size of `integrate`: one work-item for each row of blocks, or column of voxels."""
    if layout.pixels:
        return layout.over(resolution, resolution)
    return (blocks_of(resolution),) * 2, (1, 1)


class Volume:
    """A cube of resolution^3 voxels of `voxel_size` metres, and which of its blocks lie near a surface.

    Raises DeviceMemoryError when the device cannot hold it.
    """

    def __init__(self, session: Session, resolution: int, size: float) -> None:
        self.resolution = resolution
        self.voxel_size = size / resolution
        self.blocks = blocks_of(resolution)
        self._session = session
        try:
            self.voxels = session.buffer(4 * resolution**3, f"volume_resolution={resolution}")
        except DeviceMemoryError as error:
            fitting = [
                r for r in (512, 256, 128, 64) if r < resolution and 4 * r**3 <= session.device.max_allocation
            ]
            raise DeviceMemoryError(f"{error}: choose {fitting[0] if fitting else 32} or less") from error
        self._weights = session.buffer(resolution**3, f"volume_resolution={resolution}, its weights,")
        self._surface = session.buffer(4 * self.blocks**3, "the block marks")
        self.searched = session.buffer(4 * self.blocks**3, "the block marks")
        self._dilate = session.kernel(
            SOURCE, "dilate_blocks", (self.blocks, self.blocks), self._surface, self.searched,
            self.blocks,
        )  # fmt: skip
        self.clear()

    def clear(self) -> None:
        """Empty space everywhere, with nothing observed."""
        self._session.kernel(
            SOURCE, "clear_volume", (self.resolution,), self.voxels, self._weights, self.resolution,
            self._surface, self.blocks,
        )()  # fmt: skip
        self._dilate()

    def fuse_from(self, depth: cl.Buffer, camera: Camera, mu: float, state: cl.Buffer) -> None:
        """Say where depth images (metres) and the pose will be found."""
        size, group = lines_of(self._session.layout, self.resolution)
        self._integrate = self._session.kernel(
            SOURCE, "integrate", size, self.voxels, self._weights, self.resolution,
            self.voxel_size, self._surface, self.blocks, depth, camera.width,
            camera.height, intrinsics(camera), mu, constants.MAX_WEIGHT,
            NEAR_SURFACE, state, group=group,
        )  # fmt: skip

    def integrate(self) -> None:
        """Fuse the present depth image at the present pose."""
        self._integrate()
        self._dilate()

    def read(self, first: int, last: int) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
        """The planes first to last - 1 along z: distances and weights, both (planes, resolution, resolution).

        Indices are (z, y, x); voxel (z, y, x) is centred at (x + .5, y + .5, z + .5) voxel sizes. Distances
        are in units of the truncation distance, positive in front of a surface; weight 0 was never observed.
        """
        import pyopencl as cl

        shape, plane = (last - first, self.resolution, self.resolution), self.resolution**2
        words, weights = np.empty(shape, np.uint32), np.empty(shape, np.uint8)
        cl.enqueue_copy(self._session.queue, words, self.voxels, src_offset=4 * first * plane)
        cl.enqueue_copy(self._session.queue, weights, self._weights, src_offset=first * plane)
        return (words & 0xFFFF).astype(np.uint16).view(np.int16) * np.float32(1 / SCALE), weights
