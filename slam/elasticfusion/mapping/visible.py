"""Which surfels a camera sees, sorted into bands of its image: so the layout by rows needs no atomics."""

from __future__ import annotations

from pathlib import Path

from slam.camera import Camera
from slam.dense.images import intrinsics
from slam.devices.opencl import Session, defined
from slam.elasticfusion.mapping.surfels import RUN, Surfels
from slam.elasticfusion.mapping.view import View

SOURCE = Path(__file__).parents[1] / "kernels" / "binning.cl"
BAND = defined(SOURCE, "BAND")  # rows of the image


def bands_of(height: int) -> int:
    return -(-height // BAND)


class Visible:
    """`sorted`: the ids of the surfels that `view` sees, bin after bin; bin b begins at `starts[b]`.

    Bin b < bands holds what begins in band b of the image and ends in the next one at the latest; the bin
    after the last holds what reaches farther. In a bin ids ascend. There are two modes: whole discs, which
    face the camera and cover a pixel, or points, whose middle lies in the image. Several views can share one
    Visible: its content is only used while drawing.
    """

    def __init__(self, session: Session, surfels: Surfels, camera: Camera) -> None:
        self.camera = camera
        self.bands = bands_of(camera.height)
        self._surfels = surfels
        runs, what = (
            -(-surfels.capacity // RUN),
            f"surfel_capacity={surfels.capacity}, what is visible of it,",
        )
        self.sorted = session.buffer(4 * RUN * runs, what)
        self.starts = session.buffer(4 * (self.bands + 2), "the bands of an image")
        self._ids = session.buffer(4 * RUN * runs, what)
        self._bins = session.buffer(2 * RUN * runs, what)
        self._found = session.buffer(4 * runs, what)
        self._bin_counts = session.buffer(4 * runs * (self.bands + 1), what)
        self._offsets = session.kernel(
            SOURCE, "bin_offsets", (1,), 0, self.bands, self._bin_counts, self.starts
        )
        self._scatter = surfels.kernel(
            SOURCE, "scatter", self._ids, self._bins, self._found, self._bin_counts, self.sorted
        )

    def culling(self, view: View, discs: bool) -> Culling:
        """The kernels that put `view`'s surfels into `sorted`, as whole discs or as points."""
        return Culling(self, view, discs)

    def sort(self) -> None:
        """Enqueue the sorting of what was found."""
        self._offsets.set(0, self._surfels.count)
        self._offsets()
        self._scatter()


class Culling:
    """Fills a Visible with what one view sees now."""

    def __init__(self, visible: Visible, view: View, discs: bool) -> None:
        surfels, camera = visible._surfels, visible.camera
        self._visible = visible
        self._cull = surfels.kernel(
            SOURCE, "cull_discs" if discs else "cull_points", surfels.position_confidence,
            surfels.normal_radius, surfels.last_seen, view.buffer, camera.width, camera.height,
            intrinsics(camera), visible.bands, visible._ids, visible._bins, visible._found,
            visible._bin_counts,
        )  # fmt: skip

    def __call__(self) -> None:
        self._cull()
        self._visible.sort()
