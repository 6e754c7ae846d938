"""Fusing frames into the map: association, weighted means, new surfels; and cleaning up behind them.

Keller et al. 2013, section 4, and Whelan et al. 2015, section 3.1. A frame fuses every second pixel of every
second row, its own half of one diagonal: even pixels in even ticks, odd ones in odd ticks.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from slam.camera import Camera
from slam.dense.images import intrinsics
from slam.devices.opencl import Session
from slam.elasticfusion.mapping.compaction import Compaction
from slam.elasticfusion.mapping.surfels import MapFullError, Surfels

if TYPE_CHECKING:
    from slam.devices.opencl import Buffer
    from slam.elasticfusion.mapping.index_map import IndexMap
    from slam.elasticfusion.preprocessing import InputFrame

SOURCE = Path(__file__).parents[1] / "kernels" / "fusion.cl"
CLEANING = Path(__file__).parents[1] / "kernels" / "cleaning.cl"

# Metres, and angles as cosines.
ASSOCIATION_DISTANCE = 0.05  # along the ray
ASSOCIATION_NORMAL = float(np.cos(0.5))
SLANTED = 0.75  # a surfel whose normal has a smaller z in the camera's frame is seen at a slant
MOST_COARSENING = 1.5  # a disc this many times a surfel's radius only confirms it
DOUBLE_DISTANCE = 0.01  # a surfel and what it doubles lie closer than this behind each other
DOUBLE_REACH = 1.4  # radii to the side
DOUBLES = 8  # samples of 16 that may lie so
SEEN_THROUGH = 5  # pixels of 9 that must measure what lies farther behind than ASSOCIATION_DISTANCE
UNSTABLE_FRAMES = 20  # frames that an unstable surfel is kept without being measured
REMOVED_SHARE = 4  # compact the map when one in so many places is empty

# The layout of `kernels/frame.h`.
FRAME = np.dtype(
    [
        ("pose", np.float32, 12),
        ("weight", np.float32),
        ("tick", np.int32),
        ("step", np.int32),
        ("phase", np.int32),
        ("count", np.int32),
    ]
)


def shares(camera: Camera) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """The weight of a measurement by its column and by its row; a pixel's confidence is their product.

    exp(-rho^2 / 0.72), rho being the distance from the principal point in half diagonals of the image
    (Keller et al. 2013, section 4.1: sigma = 0.6).
    """
    half_diagonal = np.hypot(camera.width, camera.height) / 2
    columns = (np.arange(camera.width) - camera.cx) / half_diagonal
    rows = (np.arange(camera.height) - camera.cy) / half_diagonal
    return np.exp(-(columns**2) / 0.72).astype(np.float32), np.exp(-(rows**2) / 0.72).astype(np.float32)


class Fusion:
    """Adds frames to the map. `index_map` must have been built at the pose at which a frame is fused.

    A surfel is stable from `confidence_threshold` on. New surfels are entered into the index map, so that
    `fuse` and `clean` of one frame share it; after `clean`, identities may have changed.
    """

    def __init__(
        self,
        session: Session,
        surfels: Surfels,
        index_map: IndexMap,
        input_frame: InputFrame,
        confidence_threshold: float,
    ) -> None:
        self._session = session
        self._surfels = surfels
        self._compaction = Compaction(session, surfels)
        self._removed = 0
        self._settled = 0  # unstable surfels last seen up to this tick were removed
        image = input_frame.image
        camera, colour = image.camera, image.colour
        width, height = camera.width, camera.height
        self._size = (width, height)
        self._cells = (-(-width // 2), -(-height // 2))
        self._frame = session.buffer(FRAME.itemsize, "a frame's pose")
        matches = session.buffer(4 * width * height, "an image")
        row_new = session.buffer(4 * height, "a column")
        self._new = session.buffer(4, "a count")
        self._gone = session.buffer(4, "a count")
        session.upload(self._gone, np.zeros(1, np.int32))
        share_x, share_y = (self._uploaded(share) for share in shares(camera))
        map_arrays = (surfels.position_confidence, surfels.normal_radius, surfels.colour)
        depths = (image.depth, input_frame.filtered, *image.normals)
        self._all_new = session.image_kernel(
            SOURCE, "all_new", width, height, image.depth, *image.normals, width, height, matches
        )
        self._associate = [
            session.image_kernel(
                SOURCE, "associate", *self._cells, image.depth, *image.normals, width, height,
                intrinsics(camera), index_map.ids, surfels.position_confidence, surfels.normal_radius,
                self._frame, ASSOCIATION_DISTANCE, ASSOCIATION_NORMAL, SLANTED, matches,
            ),
            session.image_kernel(
                SOURCE, "update", *self._cells, *depths, colour, width, height, intrinsics(camera),
                share_x, share_y, index_map.ids, self._frame, MOST_COARSENING, matches, *map_arrays,
                surfels.last_seen,
            ),
        ]  # fmt: skip
        self._count_new = session.kernel(SOURCE, "count_new", (1,), matches, width, row_new)
        self._scan_rows = session.kernel(SOURCE, "scan_rows", (1,), row_new, height, self._new)
        self._append = session.kernel(
            SOURCE, "append", (1,), *depths, colour, width, intrinsics(camera), share_x, share_y,
            self._frame, matches, row_new, index_map.ids, *map_arrays, surfels.first_seen, surfels.last_seen,
        )  # fmt: skip
        marked = session.buffer(width * height, "an image")
        self._clean = [
            session.image_kernel(
                CLEANING, "mark_for_removal", width, height, image.depth, width, height, index_map.ids,
                surfels.position_confidence, surfels.normal_radius, surfels.first_seen, surfels.last_seen,
                self._frame, float(confidence_threshold), DOUBLE_DISTANCE, DOUBLE_REACH, DOUBLES,
                ASSOCIATION_DISTANCE, SEEN_THROUGH, marked,
            ),
            session.image_kernel(
                CLEANING, "remove_marked", width, height, width, height, index_map.ids, marked,
                surfels.position_confidence, self._gone,
            ),
        ]  # fmt: skip
        self._remove_unstable = surfels.kernel(
            CLEANING, "remove_unstable", surfels.last_seen, 0, 0, float(confidence_threshold),
            surfels.position_confidence, self._gone,
        )  # fmt: skip

    def initialise(self, pose: NDArray[np.float64], tick: int) -> int:
        """Add a surfel for every pixel that measures one, at full weight; returns how many.

        Raises MapFullError, leaving the map as it was, where they do not fit.
        """
        self._upload(pose, tick, 1.0, step=1, phase=0)
        self._all_new()
        return self._add(*self._size)

    def fuse(self, pose: NDArray[np.float64], tick: int, weight: float) -> int:
        """Fuse the live frame, seen from `pose` (camera to world), and return how many surfels were added.

        `weight`: of its measurements, above 0. Of pixels that measure one surfel the first counts.
        Raises MapFullError where the new surfels do not fit; the others are updated then.
        """
        self._upload(pose, tick, weight, step=2, phase=tick % 2)
        for kernel in self._associate:
            kernel()
        return self._add(*self._cells)

    def clean(self, pose: NDArray[np.float64], tick: int) -> None:
        """Remove doubles and what was seen through from `pose`, and unstable surfels not seen for long.

        Of the unstable ones outside of the view, each is checked once: when its last sight lies
        UNSTABLE_FRAMES back. What is stable and out of sight stays.
        """
        self._upload(pose, tick, 0.0, step=2, phase=tick % 2)
        for kernel in self._clean:
            kernel()
        last = tick - UNSTABLE_FRAMES - 1
        if last > self._settled:
            self._remove_unstable.set(1, self._settled + 1)
            self._remove_unstable.set(2, last)
            self._remove_unstable()
            self._settled = last
        columns, rows = self._cells
        crowded = self._surfels.count + columns * rows > self._surfels.capacity
        if self._removed > 0 and (crowded or self._removed * REMOVED_SHARE > self._surfels.count):
            self._compaction.compact()
            self._forget_removed()

    def _add(self, columns: int, rows: int) -> int:
        """Append what the matches (rows, columns) call new."""
        self._count_new.set(1, columns)
        self._scan_rows.set(1, rows)
        self._count_new((rows,))
        self._scan_rows()
        new, self._removed = self._downloaded(self._new), self._downloaded(self._gone)
        surfels = self._surfels
        if surfels.count + new > surfels.capacity:
            raise MapFullError(
                f"{surfels.count} surfels and {new} new ones exceed surfel_capacity={surfels.capacity}: "
                "raise it (44 bytes each), or lower depth_cutoff"
            )
        self._append((rows,))
        surfels.count += new
        return new

    def _upload(self, pose: NDArray[np.float64], tick: int, weight: float, step: int, phase: int) -> None:
        frame = np.zeros((), FRAME)
        frame["pose"] = pose[:3].ravel()
        frame["weight"], frame["tick"], frame["step"], frame["phase"] = weight, tick, step, phase
        frame["count"] = self._surfels.count
        self._session.upload(self._frame, frame)

    def _uploaded(self, values: NDArray[np.float32]) -> Buffer:
        buffer = self._session.buffer(values.nbytes, "a row")
        self._session.upload(buffer, values)
        return buffer

    def _downloaded(self, counter: Buffer) -> int:
        value = np.empty(1, np.int32)
        self._session.download(counter, value)
        return int(value[0])

    def _forget_removed(self) -> None:
        self._removed = 0
        self._session.upload(self._gone, np.zeros(1, np.int32))
