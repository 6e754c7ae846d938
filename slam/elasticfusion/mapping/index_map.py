"""Which surfel lies at each pixel, for the association of measurements with the map."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from slam.camera import Camera
from slam.dense.images import intrinsics
from slam.devices.opencl import Session
from slam.elasticfusion.mapping.surfels import Surfels
from slam.elasticfusion.mapping.view import View
from slam.elasticfusion.mapping.visible import Visible

SOURCE = Path(__file__).parents[1] / "kernels" / "index_map.cl"


class IndexMap:
    """`ids` (int32): the id of the surfel whose middle falls into each pixel, -1 where there is none.

    Of several the nearest one, of equally near ones the smallest id. Every living surfel counts, stable or
    not, whichever way it faces.
    """

    def __init__(
        self, session: Session, surfels: Surfels, camera: Camera, visible: Visible | None = None
    ) -> None:
        width, height = camera.width, camera.height
        self.camera = camera
        self.ids = session.buffer(4 * width * height, "an index map")
        self._view = View(session)
        depths = session.buffer(4 * width * height, "an index map")
        view, size = self._view.buffer, (width, height, intrinsics(camera))
        self._kernels: list[Callable[[], object]] = [
            session.image_kernel(SOURCE, "clear_index", width, height, width, height, depths, self.ids)
        ]
        if session.layout.pixels:
            self._kernels += [
                surfels.kernel(
                    SOURCE, "index_surfels", surfels.position_confidence, surfels.normal_radius,
                    surfels.last_seen, view, *size, choosing, depths, self.ids,
                )
                for choosing in (0, 1)
            ]  # fmt: skip
        else:
            visible = visible or Visible(session, surfels, camera)
            self._kernels += [
                visible.culling(self._view, discs=False),
                session.kernel(
                    SOURCE, "index_surfels", (visible.bands,), surfels.position_confidence,
                    surfels.normal_radius, view, *size, visible.starts, visible.sorted, depths, self.ids,
                ),
            ]  # fmt: skip

    def build(self, pose: NDArray[np.float64], seen: tuple[int, int]) -> None:
        """Enqueue it for the view from `pose` (4, 4; camera to world) of the surfels that were last seen at a
        tick from seen[0] to seen[1], both included.
        """
        self._view.show(pose, seen, 0.0)
        for kernel in self._kernels:
            kernel()
