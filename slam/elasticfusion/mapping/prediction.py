"""The model as a camera would see it: an RGB-D image, drawn from the map's discs."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from slam.camera import Camera
from slam.dense.images import intrinsics
from slam.devices.opencl import Session, defined
from slam.elasticfusion.images import RgbdImage
from slam.elasticfusion.mapping.surfels import Surfels
from slam.elasticfusion.mapping.view import View
from slam.elasticfusion.mapping.visible import Visible

SOURCE = Path(__file__).parents[1] / "kernels" / "splatting.cl"
LANES = defined(SOURCE, "LANES")  # places by which a row of working images is longer


class Prediction:
    """`image`: the last rendering; `first_seen` (int32) and `confidence` (float32) of each pixel's surfel.

    A pixel shows the nearest disc that its ray meets within the disc's radius, at the depth where it does;
    of discs that overlap, the one whose middle is nearest to the ray. All maps are 0 where there is none.
    Discs that face away, or that do not wholly lie in front of the camera, are not seen. In the layout by
    rows several predictions can share one `visible`, which saves memory.
    """

    def __init__(
        self, session: Session, surfels: Surfels, camera: Camera, visible: Visible | None = None
    ) -> None:
        self.camera = camera
        self._session = session
        width, height = camera.width, camera.height
        pixels, stride = width * height, width + LANES
        self.image = RgbdImage.allocate(session, camera)
        self.first_seen = session.buffer(4 * pixels, "an image")
        self.confidence = session.buffer(4 * pixels, "an image")
        self._rows = session.buffer(4 * height, "a column")
        self._view = View(session)
        nearness = session.buffer(4 * stride * height, "an image")
        ids = session.buffer(4 * stride * height, "an image")
        view, size = self._view.buffer, (width, height, intrinsics(camera), stride)

        self._kernels: list[Callable[[], object]] = [
            session.image_kernel(SOURCE, "clear_view", stride, height, stride, height, nearness, ids)
        ]
        if session.layout.pixels:
            self._kernels += [
                surfels.kernel(
                    SOURCE, "splat", surfels.position_confidence, surfels.normal_radius, surfels.last_seen,
                    view, *size, choosing, nearness, ids,
                )
                for choosing in (0, 1)
            ]  # fmt: skip
        else:
            visible = visible or Visible(session, surfels, camera)
            self._kernels.append(visible.culling(self._view, discs=True))
            bands = visible.bands
            # A disc may reach into the band below its own: every other band at a time, then those beyond.
            for first, step, bins in ((0, 2, -(-bands // 2)), (1, 2, bands // 2), (bands, 1, 1)):
                if bins:
                    self._kernels.append(
                        session.kernel(
                            SOURCE, "splat", (bins,), surfels.position_confidence, surfels.normal_radius,
                            view, *size, visible.starts, visible.sorted, first, step, nearness, ids,
                        )
                    )  # fmt: skip
        self._kernels += [
            session.image_kernel(
                SOURCE, "resolve", width, height, ids, stride, width, height, intrinsics(camera),
                surfels.position_confidence, surfels.normal_radius, surfels.colour, surfels.first_seen, view,
                self.image.depth, *self.image.normals, self.image.colour, self.first_seen, self.confidence,
            )
        ]  # fmt: skip
        self._count = session.kernel(
            SOURCE, "covered_of_rows", (height,), self.image.depth, width, self._rows
        )

    def render(self, pose: NDArray[np.float64], seen: tuple[int, int], confidence: float) -> None:
        """Enqueue the view from `pose` (4, 4; camera to world) of surfels of at least this confidence that
        were last seen at a tick from seen[0] to seen[1], both included.
        """
        self._view.show(pose, seen, confidence)
        for kernel in self._kernels:
            kernel()

    def covered(self) -> int:
        """The number of pixels with a surfel; waits for the device."""
        self._count()
        rows = np.empty(self.camera.height, np.int32)
        self._session.download(self._rows, rows)
        return int(rows.sum())
