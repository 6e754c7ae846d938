"""ElasticFusion on public recordings."""

from __future__ import annotations

import numpy as np
import pytest

from slam.benchmark import run
from slam.datasets import Sequence, open_sequence
from slam.system import LoopCounts
from slam.trajectories.trajectory import Trajectory, absolute_trajectory_error
from tests.slam.real import DATA, needs_real_data

pytestmark = needs_real_data


class Quartered(Sequence):
    """A recording at every fourth pixel of every fourth row: a sixteenth of the work."""

    def __init__(self, name: str) -> None:
        self._whole = open_sequence(DATA / "rgbd" / name)
        self.name = name
        self.camera = self._whole.camera.scaled(4)
        self.timestamps, self.truth = self._whole.timestamps, self._whole.truth

    def depth(self, index: int) -> np.ndarray:
        return np.ascontiguousarray(self._whole.depth(index)[::4, ::4])

    def colour(self, index: int) -> np.ndarray:
        return np.ascontiguousarray(self._whole.colour(index)[::4, ::4])

    @property
    def sha256(self) -> str:
        return self._whole.sha256


def lost(report) -> list[int]:
    return [number for number, frame in enumerate(report.frames) if frame.tracked is False]


@pytest.mark.slow
def test_redkitchen_is_tracked_to_the_end():
    """Its truth is itself an estimate, good to centimetres: KinectFusion too ends .031 m away from it."""
    report = run({}, Quartered("redkitchen"), system="elasticfusion")
    assert lost(report) == []
    assert report.ate is not None
    assert report.ate.rmse_aligned < 0.035


@pytest.mark.slow
def test_brisk_motion_is_tracked_as_open3d_does():
    """Beside the trajectory of Open3D's offline reconstruction, good to a few millimetres."""
    report = run({}, Quartered("icl_livingroom1_micro"), system="elasticfusion")
    assert lost(report) == []
    reference = Trajectory.read(DATA / "rgbd/icl_livingroom1_micro/reference_open3d.txt").poses
    assert absolute_trajectory_error(report.poses, reference).rmse_aligned < 0.02


@pytest.mark.slow
def test_closing_loops_makes_redkitchen_no_worse():
    left_open = run({"open_loop": True}, Quartered("redkitchen"), system="elasticfusion")
    closed = run({"time_window": 60}, Quartered("redkitchen"), system="elasticfusion")
    assert left_open.loops == LoopCounts()
    assert closed.loops is not None
    assert closed.loops.local > 0
    assert closed.ate is not None
    assert left_open.ate is not None
    assert closed.ate.rmse_aligned < 1.02 * left_open.ate.rmse_aligned
