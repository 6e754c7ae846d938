"""The stages of a frame: how long each takes on the reference device, and in which frames it comes."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

# Shares of a frame's time where every frame does everything (SLAMBench's KinectFusion, roughly).
STAGES = {"preprocessing": 0.15, "tracking": 0.30, "integration": 0.20, "raycasting": 0.35}
# Which stage is skipped on most frames, by the parameter that tells how seldom it comes.
PERIODS = {"tracking": "tracking_rate", "integration": "integration_rate"}


def stage_shares(parameters: Mapping[str, Any], measured: Mapping[str, float] | None) -> NDArray[np.float64]:
    """The shares of STAGES in a frame's time, 1 together: as MEASURED in seconds on the reference device, or
    usual ones for a front that has no such times.
    """
    if measured is not None and all(name in measured for name in STAGES):
        seconds = np.array([measured[name] for name in STAGES])
    else:
        seconds = np.array([share / np.sqrt(period(parameters, name)) for name, share in STAGES.items()])
    return np.asarray(seconds / seconds.sum())


def frame_stages(
    parameters: Mapping[str, Any], seconds: NDArray[np.float64], frames: int
) -> NDArray[np.float64]:
    """Seconds of each of STAGES in each frame, (stages, frames), SECONDS (stages,) in the mean. A stage that
    comes every nth frame makes that frame dear, as KinectFusion's integration does.
    """
    number = np.arange(frames)
    comes = np.stack([number % period(parameters, name) == 0 for name in STAGES]).astype(np.float64)
    return np.asarray(comes * (seconds / comes.mean(axis=1))[:, None])


def period(parameters: Mapping[str, Any], stage: str) -> int:
    """STAGE comes once in so many frames."""
    return max(int(parameters.get(PERIODS.get(stage, ""), 1)), 1)
