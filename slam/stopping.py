"""Ending a run early: what is certain of its result breaks a condition.

A condition maps `ate_max` (metres) or `runtime` (seconds a frame), or both, to values; a run ends once it is
above all of them. The largest error so far is a lower bound of the final one, unless a system corrects
earlier poses. The mean time of the counted frames so far may be wrong by MOST_CHANGE, and says nothing of a
configuration that leaves out frames by the camera's motion.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slam.trajectories.trajectory import align_first_pose
from wire.protocol import FIRST_STOP, MOST_CHANGE

Condition = Mapping[str, float]
ERROR, TIME = "ate_max", "runtime"
CONDITIONED = (ERROR, TIME)


@dataclass(frozen=True)
class Stop:
    """Where a run of `wanted` frames ended, after `frames` of them, and why."""

    frames: int
    wanted: int
    reason: str

    def __str__(self) -> str:
        return f"stopped after {self.frames} of {self.wanted} frames: {self.reason}"


@dataclass
class EarlyStop:
    """Looks after every frame whether one of `conditions` is broken, from FIRST_STOP frames on.

    `truth` (n, 4, 4) holds the true poses of all wanted frames, None where errors are not bounds. `timed`:
    whether the time so far tells the final one.
    """

    conditions: Sequence[Condition]
    wanted: int
    truth: NDArray[np.float64] | None
    timed: bool

    def after(self, poses: Sequence[NDArray[np.float64]], seconds: Sequence[float]) -> Stop | None:
        """Return why the run ends after the frames with `poses` and `seconds` of each counted one, or None.

        It never ends after the last frame, since nothing is left to save.
        """
        count = len(poses)
        if not self.conditions or not FIRST_STOP <= count < self.wanted:
            return None
        certain = {ERROR: self._largest_error(np.array(poses)) if self.truth is not None else -math.inf}
        certain[TIME] = least_time(sum(seconds) / len(seconds)) if self.timed else -math.inf
        broken = find_broken(self.conditions, certain)
        return None if broken is None else Stop(count, self.wanted, _describe(broken))

    def _largest_error(self, poses: NDArray[np.float64]) -> float:
        assert self.truth is not None
        truth = self.truth[: len(poses)]
        known = np.isfinite(truth).all(axis=(1, 2))
        if not known.any():
            return -math.inf
        moved = align_first_pose(poses[known], truth[known])
        return float(np.linalg.norm(moved[:, :3, 3] - truth[known, :3, 3], axis=1).max())


def least_time(runtime: float) -> float:
    """Return the least that the runtime (seconds a frame) of a whole run can be after FIRST_STOP frames."""
    return runtime / (1 + MOST_CHANGE)


def find_broken(conditions: Sequence[Condition], values: Mapping[str, float]) -> Condition | None:
    """Return the first of `conditions` of which every value lies below that in `values`."""
    return next((one for one in conditions if all(values[name] > one[name] for name in one)), None)


def _describe(condition: Condition) -> str:
    texts = {
        ERROR: lambda value: f"the largest error is above {100 * value:.4g} cm",
        TIME: lambda value: f"a frame takes more than {1e3 * value:.4g} ms",
    }
    return " and ".join(texts[name](value) for name, value in condition.items())
