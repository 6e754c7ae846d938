"""The map: an array of surfels on the device, in the order of their first measurement."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slam.devices.device import DeviceError
from slam.devices.opencl import BoundKernel, Session, defined

KERNELS = Path(__file__).parents[1] / "kernels"
RUN = defined(KERNELS / "surfels.h", "RUN")  # surfels that one work-item walks in the layout by rows
GROUP = 64  # work-items of a group in the layout by pixels

# A surfel on the host. position: metres in the world; confidence: above 0, of a removed one 0; normal: of
# unit length, in the world, towards the cameras that saw it; radius: metres; colour: r | g << 8 | b << 16;
# first_seen and last_seen: the ticks of the first and of the last frame that measured it.
SURFEL = np.dtype(
    [
        ("position", np.float32, 3),
        ("confidence", np.float32),
        ("normal", np.float32, 3),
        ("radius", np.float32),
        ("colour", np.uint32),
        ("first_seen", np.int32),
        ("last_seen", np.int32),
    ]
)


class MapFullError(DeviceError):
    """The map has no room for a frame's new surfels; the message suggests a remedy."""


class Surfels:
    """At most `capacity` surfels, of which the first `count` places are in use (44 bytes each).

    position_confidence: float4 (x, y, z, confidence); normal_radius: float4 (nx, ny, nz, radius); colour:
    uint32; first_seen and last_seen: int32. Places are sorted by `first_seen`. A removed surfel keeps its
    place, with confidence 0, until the map is compacted: every kernel skips it.
    Raises DeviceMemoryError when the device cannot hold them.
    """

    def __init__(self, session: Session, capacity: int) -> None:
        what = f"surfel_capacity={capacity}"
        self.capacity = capacity
        self.count = 0
        self.session = session
        self.position_confidence = session.buffer(16 * capacity, what)
        self.normal_radius = session.buffer(16 * capacity, what)
        self.colour = session.buffer(4 * capacity, what)
        self.first_seen = session.buffer(4 * capacity, what)
        self.last_seen = session.buffer(4 * capacity, what)

    @property
    def runs(self) -> int:
        """The number of runs of RUN places in use."""
        return -(-self.count // RUN)

    def kernel(self, source: Path, name: str, *arguments: Any) -> SurfelKernel:
        """The kernel `name` of a file over all surfels, whenever it is launched: EACH_SURFEL(i, count).

        Its first argument, `int count`, is given by the launch; `arguments` are those that follow.
        """
        _, group = self._over()
        return SurfelKernel(
            self, self.session.kernel(source, name, group, self.count, *arguments, group=group)
        )

    def read(self, removed: bool = False) -> NDArray[Any]:
        """The living surfels as an array of SURFEL, in the map's order; with `removed` every place in use."""
        surfels = np.zeros(self.count, SURFEL)
        if self.count == 0:
            return surfels
        positions, normals = np.empty((self.count, 4), np.float32), np.empty((self.count, 4), np.float32)
        self.session.download(self.position_confidence, positions)
        self.session.download(self.normal_radius, normals)
        for name in ("colour", "first_seen", "last_seen"):
            column = np.empty(self.count, SURFEL[name])
            self.session.download(getattr(self, name), column)
            surfels[name] = column
        surfels["position"], surfels["confidence"] = positions[:, :3], positions[:, 3]
        surfels["normal"], surfels["radius"] = normals[:, :3], normals[:, 3]
        return surfels if removed else surfels[surfels["confidence"] > 0]

    def write(self, surfels: NDArray[Any]) -> None:
        """Replace the map by SURFELs sorted by `first_seen`. Raises MapFullError if they do not fit."""
        if len(surfels) > self.capacity:
            raise MapFullError(f"{len(surfels)} surfels in a map for {self.capacity}: raise surfel_capacity")
        self.count = len(surfels)
        if self.count == 0:
            return
        self.session.upload(
            self.position_confidence, np.column_stack([surfels["position"], surfels["confidence"]])
        )
        self.session.upload(self.normal_radius, np.column_stack([surfels["normal"], surfels["radius"]]))
        for name in ("colour", "first_seen", "last_seen"):
            self.session.upload(getattr(self, name), surfels[name])

    def _over(self) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Global and local size of a kernel over all surfels, as the session's layout says."""
        if not self.session.layout.pixels:
            return (self.runs,), (1,)
        return (-(-self.count // GROUP) * GROUP,), (GROUP,)


class SurfelKernel:
    """A kernel over all surfels present at the time of each launch."""

    def __init__(self, surfels: Surfels, kernel: BoundKernel) -> None:
        self._surfels = surfels
        self._kernel = kernel

    def __call__(self) -> None:
        """Enqueue it; it does nothing for an empty map."""
        if self._surfels.count:
            self._kernel.set(0, self._surfels.count)
            self._kernel(self._surfels._over()[0])

    def set(self, index: int, value: Any) -> None:
        """Another value for one of the kernel's `arguments`, from the next launch on."""
        self._kernel.set(index + 1, value)
