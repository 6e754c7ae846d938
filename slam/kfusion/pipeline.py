"""KinectFusion, frame by frame: a plan, executed on a device."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from slam.camera import Camera
from slam.devices.device import DeviceMemoryError
from slam.devices.opencl import SHARED
from slam.kfusion.configuration import Configuration
from slam.kfusion.declarations import SCALE
from slam.kfusion.degeneracy import is_degenerate
from slam.kfusion.plan import plan
from slam.kfusion.refusals import reason
from slam.plans.execution import Execution
from slam.plans.executors import prepare
from slam.system import Frame, Scene, View

if TYPE_CHECKING:
    from slam.devices.choice import AnySession

FOLDERS = (Path(__file__).parent / "kernels", SHARED)
SAMPLED = 16  # every so many pixels count for `outside`
FITTING = (512, 256, 128, 64, 32)  # resolutions that are proposed where one does not fit


class KFusion:
    """A `slam.system.System`. The pose lives in the volume's frame, whose origin is a corner.

    The plan's frames are counted from the first image in which anything was measured: it is frame 0, at the
    initial pose. Images before it are not attempted. A lost frame keeps the last pose and is not integrated.
    Raises ConfigurationError when the images cannot be divided by the compute size ratio, and
    DeviceMemoryError when the volume does not fit the device.
    """

    def __init__(self, configuration: Configuration, scene: Scene, session: AnySession) -> None:
        self._configuration = configuration
        self._plan = plan(configuration, scene, session.layout)
        _check_memory(configuration.volume_resolution, session)
        self._execution: Execution = prepare(self._plan, session, FOLDERS)
        self._volume_size = scene.volume_size
        self._rays = _rays(scene.camera)
        self._shape = (scene.camera.height, scene.camera.width)
        camera = scene.camera.scaled(configuration.compute_size_ratio)
        self._model_shape = (camera.height, camera.width)
        checks = [d for d in self._plan.dispatches if d.kernel == "check_pose"]  # of two attempts
        self._tracking, self._limits = checks[0], [d.arguments for d in checks]
        self._integrations = [d for d in self._plan.dispatches if d.kernel == "integrate"]
        self._raycasting = next(d for d in self._plan.dispatches if d.kernel == "raycast")
        self._frame = 0
        self._state = self._plan.initial_state()  # as last read
        self._eye: NDArray[np.float32] | None = None  # where the model was seen from last
        self.volume = Volume(self._execution, configuration.volume_resolution, scene.volume_size)

    @property
    def stage_clock(self) -> str:
        """The clock of the stages: "device", "wall" or "none"."""
        return self._execution.stage_clock

    def configuration(self) -> dict[str, Any]:
        return self._configuration.to_dict()

    def view(self) -> View | None:
        """The view of the last raycast; None before the first."""
        if self._eye is None:
            return None
        vertices, normals = (
            np.moveaxis(self._execution.read(name).reshape(3, *self._model_shape), 0, -1)
            for name in ("model_vertices", "model_normals")
        )
        return View(vertices, normals, eye=self._eye)

    def process(
        self,
        depth: NDArray[np.uint16],
        colour: NDArray[np.uint8] | None = None,  # noqa: ARG002  KinectFusion does not use it
    ) -> Frame:
        """Take the next depth image: uint16 (height, width), millimetres, 0 where nothing was measured."""
        if depth.shape != self._shape or depth.dtype != np.uint16:
            raise ValueError(
                f"a depth image is uint16 {self._shape} (height, width), got {depth.dtype} {depth.shape}"
            )
        number = self._frame
        outcome = self._execution.run(number, np.ascontiguousarray(depth))
        # An image without any depth before the first one with some changes nothing: frame 0 is tried again.
        started = number > 0 or bool(outcome.state["farthest"] > 0)
        self._frame += started
        if self._raycasting.takes_place(number, self._state) and not outcome.skipped:
            self._eye = outcome.state["pose"].reshape(3, 4)[:, 3].copy()
        pose = np.eye(4)
        pose[:3] = outcome.state["pose"].reshape(3, 4)
        tracked = bool(outcome.state["tracked"])
        integrated = any(
            d.takes_place(number, self._state) and (d.flag is None or tracked) for d in self._integrations
        )
        self._state = outcome.state
        attempted = self._tracking.takes_place(number) and not outcome.skipped
        return Frame(
            pose,
            tracked if attempted else None,
            started and integrated and not outcome.skipped,
            dict(outcome.stages),
            outcome.computation,
            _degenerate(outcome.state) if attempted and tracked else None,
            reason(outcome.state, self._limits[outcome.state["retrying"]]) if attempted else None,
            skipped=outcome.skipped,
        )

    def outside(self, depth: NDArray[np.uint16]) -> float:
        """See `slam.system.Bounded`; every 16th pixel counts."""
        pose = self._state["pose"].reshape(3, 4)
        metres = depth[::SAMPLED, ::SAMPLED] / 1000
        points = pose[:, :3] @ (self._rays * metres)[:, metres > 0] + pose[:, 3:]
        beyond = ((points < 0) | (points > self._volume_size)).any(axis=0)
        return float(beyond.mean()) if beyond.size else 0.0


def _rays(camera: Camera) -> NDArray[np.float64]:
    """The rays through every 16th pixel, to a depth of 1: (3, rows, columns)."""
    y, x = np.mgrid[: camera.height : SAMPLED, : camera.width : SAMPLED]
    return np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones(x.shape)])


def _degenerate(state: np.ndarray[Any, np.dtype[np.void]]) -> bool:
    return is_degenerate(state["normal_matrix"], float(state["inliers"]), state["pose"][3::4])


class Volume:
    """The distance field on the device: a cube of resolution^3 voxels of `voxel_size` metres."""

    def __init__(self, execution: Execution, resolution: int, size: float) -> None:
        self.resolution = resolution
        self.voxel_size = size / resolution
        self._execution = execution

    def read(self, first: int, last: int) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
        """The planes first to last - 1 along z: distances and weights, both (planes, resolution, resolution).

        Indices are (z, y, x); voxel (z, y, x) is centred at (x + .5, y + .5, z + .5) voxel sizes. Distances
        are in units of the truncation distance, positive in front of a surface; weight 0 was never observed.
        """
        shape, plane = (last - first, self.resolution, self.resolution), self.resolution**2
        span = (first * plane, (last - first) * plane)
        words = self._execution.read("voxels", *span).reshape(shape)
        low = words & np.uint32(0xFFFF)
        if self._execution.plan.layout == "rows":  # signed distances, the weights in a buffer of their own
            distances = low.astype(np.uint16).view(np.int16).astype(np.float32)
            weights = self._execution.read("weights", *span).reshape(shape)
        else:  # distances counted down from SCALE, the weights in the upper half of the word
            distances = np.float32(SCALE) - low.astype(np.float32)
            weights = (words >> np.uint32(16)).astype(np.uint8)
        return distances * np.float32(1 / SCALE), weights


def _check_memory(resolution: int, session: AnySession) -> None:
    device = session.device
    try:
        device.check_allocation(4 * resolution**3, f"volume_resolution={resolution}")
    except DeviceMemoryError as error:
        fitting = [r for r in FITTING if r < resolution and 4 * r**3 <= device.max_allocation]
        raise DeviceMemoryError(f"{error}: choose {fitting[0] if fitting else 32} or less") from error
