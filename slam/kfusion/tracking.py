"""Frame-to-model tracking: ICP over the pyramid, without leaving the device."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from slam.dense.images import Level, intrinsics
from slam.dense.least_squares import SUMS, records_of
from slam.kfusion import configuration as constants
from slam.kfusion.configuration import Configuration
from slam.kfusion.raycasting import Model
from slam.opencl import BoundKernel, Session

if TYPE_CHECKING:
    import pyopencl as cl

SOURCE = Path(__file__).parent / "kernels" / "tracking.cl"


class Tracking:
    """Moves the pose in `state` so that the pyramid fits the model, and checks the result there.

    All iterations are enqueued at once; a level that has converged makes its remaining kernels return
    at once, so the host waits for nothing between them.
    """

    def __init__(
        self,
        session: Session,
        configuration: Configuration,
        levels: list[Level],
        model: Model,
        state: cl.Buffer,
    ) -> None:
        finest = levels[0].camera
        most, _, _ = records_of(session.layout, finest.width, finest.height)
        records = session.buffer(4 * SUMS * most, "the normal equations")
        kernel = session.kernel
        self._kernels: list[BoundKernel] = [kernel(SOURCE, "begin_tracking", (1,), state)]
        last_level = levels[0]
        for level, iterations in reversed(list(zip(levels, configuration.iterations, strict=False))):
            camera = level.camera
            count, size, group = records_of(session.layout, camera.width, camera.height)
            for iteration in range(iterations):
                last_level = level
                self._kernels += [
                    kernel(
                        SOURCE, "track", size, level.depth, *level.normals, camera.width, camera.height,
                        intrinsics(camera), *model.vertices, *model.normals, model.camera.width,
                        model.camera.height, constants.ASSOCIATION_DISTANCE, constants.ASSOCIATION_NORMAL,
                        iteration, state, records, group=group,
                    ),
                    kernel(
                        SOURCE, "solve", (1,), records, count, configuration.icp_threshold, iteration, state
                    ),
                ]  # fmt: skip
        pixels = last_level.camera.width * last_level.camera.height
        self._kernels.append(
            kernel(
                SOURCE, "check_pose", (1,), pixels, constants.MAX_RESIDUAL,
                constants.MIN_INLIERS, state,
            )
        )  # fmt: skip

    def track(self) -> None:
        """Enqueue the whole of it; `state` then holds the pose after the check and whether it passed."""
        for kernel in self._kernels:
            kernel()
