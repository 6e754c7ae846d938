"""The camera's rotation since the last frame, estimated before the map is used."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from slam.dense.images import intrinsics
from slam.devices.layout import SUMS
from slam.devices.opencl import Session
from slam.elasticfusion.tracking.pyramid import Pyramid

SOURCE = Path(__file__).parents[1] / "kernels" / "rotation.cl"
ITERATIONS = 10
LEAST_OVERLAP = 0.5  # of the pixels that two images share where the alignment starts

# The layout of the struct Alignment in `rotation.cl`.
ALIGNMENT = np.dtype(
    [
        ("pose", np.float32, 12),
        ("best", np.float32, 12),
        ("error", np.float32),
        ("overlap", np.float32),
        ("ended", np.int32),
    ]
)


class RotationAlignment:
    """Gauss-Newton over the three angles between the live image and the one remembered.

    It looks at the coarsest level alone. The rotation with the least mean squared brightness difference wins;
    it stops at the first worse one.
    """

    def __init__(self, session: Session, live: Pyramid) -> None:
        self._session = session
        coarsest = live.levels[-1]
        camera = coarsest.camera
        self._live = (coarsest.intensity, coarsest.gradient_x, coarsest.gradient_y)
        pixels = camera.width * camera.height
        self._earlier = tuple(session.buffer(4 * pixels, "an image") for _ in self._live)
        self._bytes = 4 * pixels
        count, size, group = session.layout.sums(camera.width, camera.height)
        records = session.buffer(4 * SUMS * count, "the normal equations")
        self._alignment = session.buffer(ALIGNMENT.itemsize, "the rotation")
        self._equations = session.kernel(
            SOURCE, "so3_linearise", size, *self._live, *self._earlier, camera.width, camera.height,
            intrinsics(camera), self._alignment, records, group=group,
        )  # fmt: skip
        self._turn = session.kernel(SOURCE, "turn", (1,), records, count, LEAST_OVERLAP, self._alignment)

    def remember(self) -> None:
        """Keep the live pyramid's brightness for the comparison with the next frame."""
        for kept, live in zip(self._earlier, self._live, strict=True):
            self._session.copy(kept, live, self._bytes)

    def align(self) -> NDArray[np.float64]:
        """The rotation (3, 3) from the live camera's axes to those of the frame remembered."""
        alignment = np.zeros((), ALIGNMENT)
        alignment["pose"] = alignment["best"] = np.eye(4)[:3].ravel()
        self._session.upload(self._alignment, alignment)
        for _ in range(ITERATIONS + 1):  # the last one only evaluates the one before
            self._equations()
            self._turn()
        self._session.download(self._alignment, alignment)
        left, _, right = np.linalg.svd(alignment["best"].reshape(3, 4)[:, :3].astype(np.float64))
        return np.asarray(left @ right)
