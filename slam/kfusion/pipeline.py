"""KinectFusion, frame by frame: preprocessing, tracking, integration, raycasting."""

from __future__ import annotations

from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slam.configuration import ConfigurationError
from slam.kfusion.configuration import FRAMES_WITHOUT_TRACKING, LEVELS, Configuration
from slam.kfusion.preprocessing import Preprocessing
from slam.kfusion.raycasting import Model
from slam.kfusion.tracking import Tracking
from slam.kfusion.volume import Volume
from slam.opencl import Session
from slam.system import STAGES, Frame, Scene, View

# The layout of `kernels/state.h`.
STATE = np.dtype(
    [
        ("pose", np.float32, 12),
        ("previous", np.float32, 12),
        ("view", np.float32, 12),
        ("squared_error", np.float32),
        ("inliers", np.float32),
        ("converged", np.int32),
        ("tracked", np.int32),
        ("farthest", np.float32),
    ]
)


class KFusion:
    """A `slam.system.System`. The pose lives in the volume's frame, whose origin is a corner.

    Frames 0 to 3 are integrated where the camera starts; the first raycast follows frame 3, so frame 4
    is the first that can be tracked. A lost frame keeps the last pose and is not integrated.
    Raises ConfigurationError when the images cannot be divided by the compute size ratio, and
    DeviceMemoryError when the volume does not fit the device.
    """

    def __init__(self, configuration: Configuration, scene: Scene, session: Session) -> None:
        ratio = configuration.compute_size_ratio
        try:
            camera = scene.camera.scaled(ratio)
        except ValueError as error:
            raise ConfigurationError(f"compute_size_ratio={ratio}: {error}") from error
        if min(camera.width, camera.height) < 2 ** (LEVELS - 1):
            raise ConfigurationError(
                f"compute_size_ratio={ratio}: leaves {camera.width}x{camera.height} pixels, "
                f"too few for {LEVELS} levels"
            )
        if scene.volume_size <= 0:
            raise ConfigurationError(f"volume_size={scene.volume_size}: must be above 0 (metres)")
        self._configuration = configuration
        self._session = session
        self._shape = (scene.camera.height, scene.camera.width)
        self._frame = 0
        self._raycast_exists = False
        self._state = np.zeros((), STATE)
        start = np.hstack([np.eye(3), np.array(scene.initial_position)[:, None] * scene.volume_size])
        self._state["pose"] = start.ravel()
        self._device_state = session.buffer(STATE.itemsize, "the pose")
        self._upload_state()

        self._preprocessing = Preprocessing(session, scene.camera, ratio, LEVELS, self._device_state)
        self._volume = Volume(session, configuration.volume_resolution, scene.volume_size)
        self._volume.fuse_from(self._preprocessing.depth, camera, configuration.mu, self._device_state)
        self._model = Model(session, self._volume, camera, configuration.mu, self._device_state)
        self._tracking = Tracking(
            session, configuration, self._preprocessing.levels, self._model, self._device_state
        )
        session.finish()

    def configuration(self) -> dict[str, Any]:
        return self._configuration.to_dict()

    @property
    def volume(self) -> Volume:
        """The distance field, which can be read back from the device."""
        return self._volume

    def view(self) -> View | None:
        """What the last raycast saw, thus from the pose after the last frame; None before the first."""
        if not self._raycast_exists:
            return None
        return View(*self._model.read(), eye=self._state["pose"].reshape(3, 4)[:, 3].copy())

    def process(
        self,
        depth: NDArray[np.uint16],
        colour: NDArray[np.uint8] | None = None,  # noqa: ARG002  it has no use for it
    ) -> Frame:
        """Take the next depth image: uint16 (height, width), millimetres, 0 where nothing was measured."""
        if depth.shape != self._shape or depth.dtype != np.uint16:
            raise ValueError(
                f"a depth image is uint16 {self._shape} (height, width), got {depth.dtype} {depth.shape}"
            )
        number, rates = self._frame, self._configuration
        clock = [perf_counter()]

        self._preprocessing.filter(np.ascontiguousarray(depth))
        self._session.finish()
        clock.append(perf_counter())

        attempted = self._raycast_exists and number % rates.tracking_rate == 0
        if attempted:
            self._preprocessing.build_pyramid()
            self._tracking.track()
            self._download_state()
        clock.append(perf_counter())

        integrated = number < FRAMES_WITHOUT_TRACKING or bool(
            self._state["tracked"] and number % rates.integration_rate == 0
        )
        if integrated:
            self._volume.integrate()
            self._session.finish()
        clock.append(perf_counter())

        if number >= FRAMES_WITHOUT_TRACKING - 1:
            self._model.raycast()
            self._session.finish()
            self._raycast_exists = True
        clock.append(perf_counter())

        self._frame += 1
        pose = np.eye(4)
        pose[:3] = self._state["pose"].reshape(3, 4)
        seconds = {
            stage: after - before for stage, before, after in zip(STAGES, clock, clock[1:], strict=False)
        }
        return Frame(pose, bool(self._state["tracked"]) if attempted else None, integrated, seconds)

    def _upload_state(self) -> None:
        import pyopencl as cl

        cl.enqueue_copy(self._session.queue, self._device_state, self._state)

    def _download_state(self) -> None:
        import pyopencl as cl

        cl.enqueue_copy(self._session.queue, self._state, self._device_state)
