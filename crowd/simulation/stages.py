"""The stages of a frame: their times on the reference device, and the frames in which they run."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

# Shares of the time of a frame with all stages (roughly those of SLAMBench's KinectFusion).
STAGES = {"preprocessing": 0.15, "tracking": 0.30, "integration": 0.20, "raycasting": 0.35}
# The parameters that set how often a stage runs.
PERIODS = {"tracking": "tracking_rate", "integration": "integration_rate"}


def stage_shares(parameters: Mapping[str, Any], measured: Mapping[str, float]) -> NDArray[np.float64]:
    """The shares of STAGES in the time of a frame, with sum 1.

    From `measured` times on the reference device; typical shares for a system with other stages.
    """
    if all(name in measured for name in STAGES):
        seconds = np.array([measured[name] for name in STAGES])
    else:
        seconds = np.array([share / np.sqrt(period(parameters, name)) for name, share in STAGES.items()])
    return np.asarray(seconds / seconds.sum())


def frame_stages(
    parameters: Mapping[str, Any], seconds: NDArray[np.float64], frames: int
) -> NDArray[np.float64]:
    """Seconds of STAGES in each frame, (stages, frames), with the means `seconds` (stages,).

    A stage that runs every n-th frame takes its time in these frames, like KinectFusion's integration.
    """
    number = np.arange(frames)
    runs = np.stack([number % period(parameters, name) == 0 for name in STAGES]).astype(np.float64)
    return np.asarray(runs * (seconds / runs.mean(axis=1))[:, None])


def period(parameters: Mapping[str, Any], stage: str) -> int:
    """The number of frames between two runs of `stage`."""
    return max(int(parameters.get(PERIODS.get(stage, ""), 1)), 1)
