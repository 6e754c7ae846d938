"""Closing loops: recognising earlier views, measuring the gap, and correcting it.

Whelan et al. 2015, sections 6 (local loops, by registering the active to the inactive model) and 7 (global
ones, by random ferns). This module decides; the pipeline renders, registers and moves surfels.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from slam.camera import Camera
from slam.configuration import ConfigurationError
from slam.elasticfusion.configuration import REFERENCE_PIXELS, Configuration
from slam.elasticfusion.loops.ferns import Ferns, Keyframe, overlap
from slam.elasticfusion.loops.graph import Deformation, Graph
from slam.elasticfusion.loops.optimisation import Constraints, optimise
from slam.elasticfusion.loops.pose_log import PoseLog
from slam.elasticfusion.loops.thumbnail import Thumbnail

if TYPE_CHECKING:
    from slam.elasticfusion.tracking.odometry import Registration

Array = NDArray[np.float64]
Verify = Callable[[Thumbnail, Thumbnail], "Registration"]  # first view registered to the second's camera

FERN_STEP = 10  # every how many ferns give a pair of points to a global closure
GRID_COLUMNS = 32  # of the points that a local closure draws together
FEWEST_PAIRS = 10  # that a local closure needs
KEPT_PAIRS = 3  # pairs of each local closure that later global ones keep together
AGE = 1.5  # a keyframe closes a loop when it is older than so many time windows
GIVE_UP_ENERGY = 10.0  # of a global closure after its first step


@dataclass(frozen=True)
class Recognition:
    """The pose (4, 4) that a keyframe gives the present view, in the world the keyframe belongs to."""

    keyframe: Keyframe
    pose: Array
    view: Thumbnail


@dataclass(frozen=True)
class Closure:
    """A closed loop: the corrected pose (4, 4) and what moves the map.

    After a `local` closure the old surface that the camera sees is the active one again.
    """

    pose: Array
    deformation: Deformation
    local: bool


@dataclass(frozen=True)
class Grid:
    """Points of the active view (m, 3), float64 in the camera's frame, and two ticks of each, int64 (m,).

    `times`: when the active surface there was born; `old_times`: when the inactive surface behind the same
    pixel was.
    """

    points: Array
    times: NDArray[np.int64]
    old_times: NDArray[np.int64]

    @classmethod
    def sampled(
        cls,
        depth: NDArray[np.float32],
        first_seen: NDArray[np.int32],
        old_first_seen: NDArray[np.int32],
        camera: Camera,
    ) -> Grid:
        """About GRID_COLUMNS columns of pixels that both views cover; images (height, width), 0 where none.

        `depth` and `first_seen` are those of the active view, `old_first_seen` that of the inactive one.
        """
        step = max(1, camera.width // GRID_COLUMNS)
        rows, columns = np.mgrid[step // 2 : camera.height : step, step // 2 : camera.width : step]
        z = depth[rows, columns].astype(np.float64)
        times, old_times = (image[rows, columns].astype(np.int64) for image in (first_seen, old_first_seen))
        points = np.stack(
            [(columns - camera.cx) / camera.fx * z, (rows - camera.cy) / camera.fy * z, z], axis=-1
        )
        both = (z > 0) & (times > 0) & (old_times > 0)
        return cls(points[both], times[both], old_times[both])

    def born_after(self, tick: int) -> Grid:
        """The points whose active surface was born after that tick."""
        younger = self.times > tick
        return Grid(self.points[younger], self.times[younger], self.old_times[younger])


class LoopClosing:
    """The views seen before, the loops that were closed, and the corrected trajectory.

    `camera` is that of the thumbnails, `verify` registers one thumbnail to another by their depth alone. With
    open_loop it only recognises views, for a lost camera.
    Raises ConfigurationError where loops are to be closed without scipy, which solves for deformations.
    """

    def __init__(self, configuration: Configuration, camera: Camera, verify: Verify) -> None:
        if not configuration.open_loop:
            try:
                import scipy.sparse.linalg  # noqa: F401  # now, and not in the frame that closes the first loop
            except ImportError as error:
                raise ConfigurationError(
                    "open_loop=false: closing loops needs scipy: pip install scipy, or set open_loop=true"
                ) from error
        self._thresholds = configuration
        self._verify = verify
        self._ferns = Ferns(camera, configuration.depth_cutoff, configuration.seed)
        self._kept = Constraints.none()
        self._closed_at = 0  # the tick of the last local closure
        self._log = PoseLog()

    def poses(self) -> Array:
        """The pose of every logged frame (n, 4, 4), moved by the global closures since."""
        return self._log.poses()

    def log(self, pose: Array, tick: int) -> None:
        """Add a frame to the trajectory."""
        self._log.append(pose, tick)

    def remember(self, view: Thumbnail, pose: Array, tick: int) -> bool:
        """Keep the view as a keyframe where none is like it; whether it was kept."""
        return self._ferns.add(view, pose, tick, self._thresholds.fern_threshold)

    def recognise(self, view: Thumbnail, tick: int, lost: bool) -> Recognition | None:
        """The keyframe that saw the same from about here, verified by shape and by colour; None without one.

        It must be older than AGE time windows. A `lost` camera accepts any keyframe, and fewer inliers.
        Inliers are counted among the pixels that both views measured: the published share of all pixels is
        out of reach where a sensor leaves holes or the cutoff takes half of the view. A registration that
        slid along walls has large deviations, which the published system does not check.
        """
        limits = self._thresholds
        before = tick + 1 if lost else tick - int(AGE * limits.time_window)
        code = self._ferns.encode(view)
        similar = self._ferns.most_similar(code, before)
        if similar is None or not self._ferns.agreement(code, similar) > limits.fern_agreement:
            return None
        key = self._ferns.keyframes[similar]
        registration = self._verify(view, key.view)
        if not (
            registration.icp_error < limits.fern_error_threshold
            and registration.is_certain(limits.fern_deviation_threshold)
        ):
            return None
        share = limits.fern_inliers_lost if lost else limits.fern_inliers
        compared = overlap(view, key.view, registration.pose) * REFERENCE_PIXELS
        if not registration.icp_inliers > share * compared:
            return None
        if not self._ferns.colour_distance(view, key, registration.pose) < limits.photometric_threshold:
            return None
        return Recognition(key, key.pose @ registration.pose, view)

    def close_globally(self, found: Recognition, pose: Array, nodes: Graph, tick: int) -> Closure | None:
        """Bring what is seen from `pose` to where the recognised keyframe saw it; None where that fails.

        `nodes` are those of the local graph. A loop is closed when its gap was large before and is small
        after, and the deformation's energy is low. Keyframes, trajectory and earlier loops move along.
        """
        limits = self._thresholds
        points = self._ferns.points(found.view, FERN_STEP)
        pairs = Constraints(
            _moved(pose, points),
            np.full(len(points), tick),
            _moved(found.pose, points),
            np.full(len(points), found.keyframe.tick),
        )
        if pairs.mean_distance() < limits.closure_distance:
            return None
        best = optimise(nodes.thinned(), pairs, self._kept, give_up_above=GIVE_UP_ENERGY)
        if best is None or not (best.distance < limits.closure_error and best.energy < limits.closure_energy):
            return None
        self._deform(best.deformation)
        self._log.deform(best.deformation)
        return Closure(found.pose, best.deformation, local=False)

    def close_locally(
        self, registration: Registration, pose: Array, grid: Grid, nodes: Graph, tick: int
    ) -> Closure | None:
        """Bring the active model to where the inactive one is, given the registration of the two.

        Both were seen from `pose`; `registration.pose` takes points of the active view's camera to the
        inactive one's. None where that is too uncertain. Nodes that an earlier local closure has placed stay
        fixed. A point of the active view moves with the surfels of its own first tick. The paper uses the
        frame's tick instead: a surface that was first seen a while ago then moves only half the way. Surfels
        older than the time window give no pair: most of their contemporaries are inactive and would be
        separated from them.
        """
        grid = grid.born_after(tick - self._thresholds.time_window)
        if not self.accepts(registration) or len(grid.times) < FEWEST_PAIRS:
            return None
        corrected = pose @ registration.pose
        pairs = Constraints(
            _moved(pose, grid.points), grid.times, _moved(corrected, grid.points), grid.old_times
        )
        best = optimise(nodes, pairs, free=nodes.times > self._closed_at)
        if best is None:
            return None
        self._closed_at = tick
        self._deform(best.deformation)
        self._log.deform(best.deformation)
        kept = pairs.taken(np.linspace(0, len(pairs) - 1, KEPT_PAIRS).astype(int)).deformed(best.deformation)
        self._kept = self._kept.joined(kept)
        return Closure(corrected, best.deformation, local=True)

    def accepts(self, registration: Registration) -> bool:
        """Whether the registration of two models is accurate enough to close a loop."""
        limits = self._thresholds
        return bool(
            registration.is_certain(limits.icp_deviation_threshold)
            and registration.icp_inliers > limits.icp_count_threshold
            and registration.icp_error < limits.icp_error_threshold
        )

    def _deform(self, deformation: Deformation) -> None:
        self._ferns.deform(deformation)
        self._kept = self._kept.deformed(deformation)


def _moved(pose: Array, points: Array) -> Array:
    return np.asarray(points @ pose[:3, :3].T + pose[:3, 3])
