"""ElasticFusion, frame by frame: tracking against the map, closing loops, fusion, prediction.

Whelan et al. 2015, "ElasticFusion: Dense SLAM Without A Pose Graph", and its journal version of 2016.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slam.configuration import ConfigurationError
from slam.devices.opencl import Session
from slam.elasticfusion import configuration as constants
from slam.elasticfusion.configuration import Configuration
from slam.elasticfusion.loops.deformer import MapDeformer
from slam.elasticfusion.loops.registration import Loops
from slam.elasticfusion.loops.thumbnail import read
from slam.elasticfusion.mapping import cloud
from slam.elasticfusion.mapping.fill_in import FillIn
from slam.elasticfusion.mapping.fusion import Fusion
from slam.elasticfusion.mapping.index_map import IndexMap
from slam.elasticfusion.mapping.prediction import Prediction
from slam.elasticfusion.mapping.surfels import Surfels
from slam.elasticfusion.mapping.visible import Visible
from slam.elasticfusion.preprocessing import InputFrame
from slam.elasticfusion.tracking.monitor import TrackingMonitor
from slam.elasticfusion.tracking.tracking import Tracking
from slam.system import STAGES, Frame, LoopCounts, Scene, View

Pose = NDArray[np.float64]

SMALLEST = 32  # pixels of width and height: the coarsest level of the pyramid then has 8
FOREVER = 2**30  # a time window in ticks that never ends


class ElasticFusion:
    """A `slam.system.System`. The world is the frame of the first camera.

    The first frame that measures anything makes the map and is not tracked. A frame that is not tracked well
    enough is not fused; with `relocalisation` the camera is lost after several, and relocalised by keyframes.
    The tick does not advance while it is lost. Raises ConfigurationError for images too small, or too large
    for the map's capacity; DeviceMemoryError where the map does not fit the device.
    """

    def __init__(self, configuration: Configuration, scene: Scene, session: Session) -> None:
        sensor, ratio = scene.camera, configuration.compute_size_ratio
        try:
            camera = sensor.scaled(ratio)
        except ValueError as error:
            raise ConfigurationError(f"compute_size_ratio={ratio}: {error}") from error
        if min(camera.width, camera.height) < SMALLEST:
            remedy = f": lower compute_size_ratio={ratio}" if ratio > 1 else ""
            raise ConfigurationError(
                f"images of {camera.width}x{camera.height}: ElasticFusion needs {SMALLEST} pixels each way"
                f"{remedy}"
            )
        if configuration.surfel_capacity < camera.width * camera.height:
            raise ConfigurationError(
                f"surfel_capacity={configuration.surfel_capacity}: a frame alone makes up to "
                f"{camera.width * camera.height}: give a few times that"
            )
        self._configuration = configuration
        self._session = session
        self._shape = (sensor.height, sensor.width)
        self._pose: Pose = np.eye(4)
        self._tick = 1
        self._monitor = TrackingMonitor(configuration.relocalisation)
        self._counts = LoopCounts()
        self._window = FOREVER if configuration.open_loop else configuration.time_window

        self._input_frame = InputFrame(session, sensor, configuration.depth_cutoff, ratio)
        self._surfels = Surfels(session, configuration.surfel_capacity)
        visible = Visible(session, self._surfels, camera)
        self._prediction = Prediction(session, self._surfels, camera, visible)
        self._fill_in = FillIn(session, self._prediction.image, self._input_frame.image)
        self._tracking = Tracking(session, configuration, self._input_frame.image, self._fill_in.image)
        self._index_map = IndexMap(session, self._surfels, camera, visible)
        self._fusion = Fusion(
            session, self._surfels, self._index_map, self._input_frame, configuration.confidence_threshold
        )
        self._deformer = MapDeformer(session, self._surfels)
        self._loops = Loops(session, configuration, self._surfels, self._prediction, self._fill_in, visible)
        session.finish()

    @property
    def stage_clock(self) -> str:
        """The host times each stage and waits for the device after it."""
        return "wall"

    def configuration(self) -> dict[str, Any]:
        return self._configuration.to_dict()

    @property
    def surfels(self) -> Surfels:
        """The map, which can be read back from the device."""
        return self._surfels

    def poses(self) -> Pose:
        """The poses of all frames so far (n, 4, 4), as the loops closed since have left them."""
        return self._loops.poses()

    def loop_counts(self) -> LoopCounts:
        """The loops closed so far, and how often the camera was lost and found again."""
        return self._counts

    def view(self) -> View | None:
        """The stable surfels, and the live frame where there are none, from the pose after the last frame."""
        if self._surfels.count == 0:
            return None
        seen = read(self._session, self._fill_in.image)
        rotation, eye = self._pose[:3, :3].astype(np.float32), self._pose[:3, 3].astype(np.float32)
        colour = np.stack([seen.colour >> shift & 255 for shift in (0, 8, 16)], axis=-1).astype(np.uint8)
        vertices = np.where(seen.depth[..., None] > 0, seen.vertices @ rotation.T + eye, 0)
        return View(vertices.astype(np.float32), seen.normals @ rotation.T, eye, colour)

    def export(self, path: Path) -> str:
        """Write the stable surfels as a PLY file."""
        count = cloud.write(path, self._surfels.read(), float(self._configuration.confidence_threshold))
        return f"{count} stable surfels in {path}"

    def process(self, depth: NDArray[np.uint16], colour: NDArray[np.uint8] | None = None) -> Frame:
        """Take the next frame: depth uint16 (height, width), millimetres, 0 where nothing was measured, and
        colour uint8 (height, width, 3), red green blue.
        """
        if depth.shape != self._shape or depth.dtype != np.uint16:
            raise ValueError(
                f"a depth image is uint16 {self._shape} (height, width), got {depth.dtype} {depth.shape}"
            )
        if colour is None or colour.shape != (*self._shape, 3) or colour.dtype != np.uint8:
            got = "none" if colour is None else f"{colour.dtype} {colour.shape}"
            raise ValueError(f"a colour image is uint8 {(*self._shape, 3)} (height, width, 3), got {got}")
        clock = [perf_counter()]

        self._input_frame.take(np.ascontiguousarray(depth), np.ascontiguousarray(colour))
        self._session.finish()
        clock.append(perf_counter())

        tracked, weight = self._track()
        clock.append(perf_counter())

        integrated = self._integrate(tracked, weight)
        self._session.finish()
        clock.append(perf_counter())

        self._predict(tracked)
        if not self._monitor.lost:
            self._tick += 1
        self._session.finish()
        clock.append(perf_counter())

        seconds = {
            stage: after - before for stage, before, after in zip(STAGES, clock, clock[1:], strict=False)
        }
        return Frame(self._pose.copy(), tracked, integrated, seconds, clock[-1] - clock[0])

    def _track(self) -> tuple[bool | None, float]:
        """Update the pose; returns whether tracking succeeded (None without a map) and a weight."""
        if self._surfels.count == 0:
            self._tracking.begin()
            return None, 1.0
        step = self._tracking.track()
        self._pose = self._pose @ step.motion
        was_lost = self._monitor.lost
        self._monitor.record(step.good)
        if was_lost and not self._monitor.lost:
            self._counts = replace(self._counts, relocalisations=self._counts.relocalisations + 1)
        return step.good and not self._monitor.lost, velocity_weight(step.motion)

    def _integrate(self, tracked: bool | None, weight: float) -> bool:
        """Close loops, fuse the frame and clean the map; returns whether it was fused."""
        if tracked is None:
            fused = self._fusion.initialise(self._pose, self._tick) > 0
        else:
            self._close_loops()
            fused = self._monitor.fuses(tracked)
            if fused:
                self._index_map.build(self._pose, self._active)
                self._fusion.fuse(self._pose, self._tick, weight)
                self._fusion.clean(self._pose, self._tick)
        self._loops.log(self._pose, self._tick)
        return fused

    def _close_loops(self) -> None:
        """Correct the pose and the map where the camera recognises an earlier view."""
        if self._monitor.lost:
            pose = self._loops.relocalise(self._tick)
            if pose is not None:
                self._pose = pose
                self._monitor.recognised()
            return
        closure = self._loops.close(self._pose, self._tick, self._active)
        if closure is None:
            return
        self._deformer.deform(closure.deformation, self._tick)
        self._pose = closure.pose
        if closure.local:
            self._counts = replace(self._counts, local=self._counts.local + 1)
            surface = self._loops.inactive(self._pose, self._active)
            stable = self._configuration.confidence_threshold
            self._deformer.reactivate(surface, self._pose, self._tick, stable)
        else:
            self._counts = replace(self._counts, global_=self._counts.global_ + 1)

    def _predict(self, tracked: bool | None) -> None:
        """Render what the next frame is tracked against: the map from the current pose, with gaps filled in.

        A lost camera uses only its last frame. A relocalised camera on probation is checked against the whole
        map and nothing else. A view from an uncertain pose does not become a keyframe.
        """
        monitor, stable = self._monitor, self._configuration.confidence_threshold
        if monitor.on_probation:
            self._prediction.render(self._pose, (0, self._tick), 0.0)
            self._fill_in.fill(holes=False)
        elif monitor.lost:
            self._fill_in.fill(keep_depth=False, keep_colour=False)
        else:
            self._prediction.render(self._pose, self._active, stable)
            self._fill_in.fill()
            if tracked is not False:
                self._loops.remember(self._pose, self._tick)
            if self._configuration.frame_to_frame_rgb:
                self._fill_in.fill(keep_colour=False)

    @property
    def _active(self) -> tuple[int, int]:
        """The first and the last tick of the active time window."""
        return max(0, self._tick - self._window), self._tick


def velocity_weight(motion: Pose) -> float:
    """The weight of a frame after a motion (4, 4): 1 at rest, less when fast, at least half."""
    cosine = np.clip((np.trace(motion[:3, :3]) - 1) / 2, -1, 1)
    speed = max(float(np.linalg.norm(motion[:3, 3])), float(np.arccos(cosine)))
    return max(1 - speed / constants.FULL_WEIGHT_BELOW, constants.MIN_VELOCITY_WEIGHT)
