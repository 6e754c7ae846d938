"""The device's part of closing loops: views of the active and inactive map, and their registration."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from slam.devices.opencl import Session
from slam.elasticfusion.configuration import ICP_ONLY, LOOP_ICP_WEIGHT, REFERENCE_PIXELS, Configuration
from slam.elasticfusion.images import RgbdImage
from slam.elasticfusion.loops.closing import Closure, Grid, LoopClosing
from slam.elasticfusion.loops.deformer import MapDeformer
from slam.elasticfusion.loops.graph import Graph, sampling
from slam.elasticfusion.loops.thumbnail import Sampling, Thumbnail, write
from slam.elasticfusion.mapping.fill_in import FillIn
from slam.elasticfusion.mapping.prediction import Prediction
from slam.elasticfusion.mapping.surfels import Surfels
from slam.elasticfusion.mapping.visible import Visible
from slam.elasticfusion.tracking.odometry import Odometry, Registration
from slam.elasticfusion.tracking.pyramid import Pyramid

if TYPE_CHECKING:
    from slam.devices.opencl import Buffer

THUMBNAIL_WIDTH = 80  # pixels, about
THUMBNAIL_HEIGHT = 8  # pixels at least: two are left on the third level
# A keyframe is registered by colour and then by depth alone, over a pyramid. By depth on one level, as the
# published system does it, views of a wall slide along it and fit well 8 cm beside the truth.
THUMBNAIL_ITERATIONS = (10, 10, 10)
THUMBNAIL_ICP_WEIGHTS = (0.5, ICP_ONLY)


class Loops:
    """Finds loops that the current view closes, locally or by a keyframe, and the pose of a lost camera.

    `prediction` and `fill_in` are the pipeline's, and are rendered again here.
    """

    def __init__(
        self,
        session: Session,
        configuration: Configuration,
        surfels: Surfels,
        prediction: Prediction,
        fill_in: FillIn,
        visible: Visible,
    ) -> None:
        camera = prediction.camera
        self._session = session
        self._surfels = surfels
        self._configuration = configuration
        self._prediction = prediction
        self._fill_in = fill_in
        self._deformer = MapDeformer(session, surfels)
        self._inactive = Prediction(session, surfels, camera, visible)
        self._active_pyramid = Pyramid(session, prediction.image)
        self._inactive_pyramid = Pyramid(session, self._inactive.image)
        self._odometry = Odometry(
            session, self._active_pyramid, self._inactive_pyramid, LOOP_ICP_WEIGHT,
            fast=configuration.fast_odometry,
        )  # fmt: skip
        self._fewest = configuration.icp_count_threshold * camera.width * camera.height / REFERENCE_PIXELS

        ratio = max(1, min(camera.width // THUMBNAIL_WIDTH, camera.height // THUMBNAIL_HEIGHT))
        self._sampling = Sampling(session, fill_in.image, ratio)
        small = self._sampling.image.camera
        self._views = [RgbdImage.allocate(session, small) for _ in range(2)]
        self._view_pyramids = [
            Pyramid(session, view, levels=len(THUMBNAIL_ITERATIONS)) for view in self._views
        ]
        view, key = self._view_pyramids
        self._view_odometries = [
            Odometry(session, view, key, weight, THUMBNAIL_ITERATIONS) for weight in THUMBNAIL_ICP_WEIGHTS
        ]
        self._closing = LoopClosing(configuration, small, self._verify)

    def poses(self) -> NDArray[np.float64]:
        return self._closing.poses()

    def log(self, pose: NDArray[np.float64], tick: int) -> None:
        """Add a frame to the trajectory."""
        self._closing.log(pose, tick)

    def remember(self, pose: NDArray[np.float64], tick: int) -> None:
        """Keep the filled-in prediction as a keyframe if no similar one exists."""
        self._closing.remember(self._sampling.read(), pose, tick)

    def relocalise(self, tick: int) -> NDArray[np.float64] | None:
        """The pose of the live image, by the keyframe that shows the same; None without one."""
        self._fill_in.fill(keep_depth=False, keep_colour=False)
        recognition = self._closing.recognise(self._sampling.read(), tick, lost=True)
        return None if recognition is None else recognition.pose

    def close(self, pose: NDArray[np.float64], tick: int, active: tuple[int, int]) -> Closure | None:
        """The loop that the view from `pose` closes, by a keyframe if there is one, or None."""
        if self._configuration.open_loop or active[0] <= 1:
            return None  # everything is active, or nothing is old enough
        self._prediction.render(pose, active, self._configuration.confidence_threshold)
        return self._close_globally(pose, tick) or self._close_locally(pose, tick, active)

    def inactive(self, pose: NDArray[np.float64], active: tuple[int, int]) -> RgbdImage:
        """The view from `pose` of stable surfels that were last seen before the `active` ticks."""
        self._inactive.render(pose, (0, active[0] - 1), self._configuration.confidence_threshold)
        return self._inactive.image

    def _close_globally(self, pose: NDArray[np.float64], tick: int) -> Closure | None:
        self._fill_in.fill()
        recognition = self._closing.recognise(self._sampling.read(), tick, lost=False)
        return (
            None
            if recognition is None
            else self._closing.close_globally(recognition, pose, self._nodes(), tick)
        )

    def _close_locally(self, pose: NDArray[np.float64], tick: int, active: tuple[int, int]) -> Closure | None:
        self.inactive(pose, active)
        # A registration cannot have more inliers than pixels that the old map covers.
        if self._inactive.covered() <= self._fewest:
            return None
        self._active_pyramid.build()
        self._inactive_pyramid.build()
        registration = self._odometry.register(np.eye(4))
        if not self._closing.accepts(registration):
            return None
        grid = Grid.sampled(
            self._downloaded(self._prediction.image.depth, np.float32),
            self._downloaded(self._prediction.first_seen, np.int32),
            self._downloaded(self._inactive.first_seen, np.int32),
            self._prediction.camera,
        )
        return self._closing.close_locally(registration, pose, grid, self._nodes(), tick)

    def _nodes(self) -> Graph:
        return self._deformer.sample(sampling(self._surfels.count, self._prediction.camera))

    def _verify(self, view: Thumbnail, key: Thumbnail) -> Registration:
        """The view registered to a keyframe's; the quality of the fit is that of depth alone."""
        for image, pyramid, thumbnail in zip(self._views, self._view_pyramids, (view, key), strict=True):
            write(self._session, image, thumbnail)
            pyramid.build()
        by_colour, by_depth = self._view_odometries
        return by_depth.register(by_colour.register(np.eye(4)).pose)

    def _downloaded(self, buffer: Buffer, kind: type[np.generic]) -> NDArray[Any]:
        camera = self._prediction.camera
        image = np.empty((camera.height, camera.width), kind)
        self._session.download(buffer, image)
        return image
