"""The record of a run from its report, and when a run has failed."""

import math
import uuid
from collections.abc import Mapping
from typing import Any

from client_kit.delivery.reference_trajectories import Positions, deviation
from client_kit.measuring.session import MICROSECONDS, Run
from client_kit.measuring.worker_client import Outcome
from slam.system import STAGES
from slam.validity import tracking_failure


def recorded(name: str, repeat: int, order: int, outcome: Outcome | str, reference: Positions) -> Run:
    """The run of the configuration `name` with `outcome`, which is a reason if it failed.

    `reference` is the configuration's reference trajectory.
    """
    run_id = uuid.uuid4()
    if isinstance(outcome, str):
        return Run(run_id, name, repeat, order, "failed", [], failure=outcome)
    frames, ate = outcome.report["frames"], outcome.report["ate"] or {}
    errors = [ate.get(error) for error in ("max", "mean", "rmse")]
    far = deviation(outcome.positions, reference)
    if not all(value is None or math.isfinite(value) for value in (*errors, far)):
        return Run(run_id, name, repeat, order, "failed", [], failure="the trajectory is not finite")
    tracked = [frame["tracked"] for frame in frames]
    failure = tracking_failure(tracked)
    return Run(
        run_id,
        name,
        repeat,
        order,
        "failed" if failure else "ok",
        [round(frame["computation"] * MICROSECONDS) for frame in frames],
        failure=failure,
        stages_us=_stages_us(frames),
        tracked=tracked,
        ate_max=errors[0],
        ate_mean=errors[1],
        ate_rmse=errors[2],
        cpu_us=outcome.cpu_us,
        waited_us=outcome.waited_us,
        deviation=None if failure else far,
    )


def _stages_us(frames: list[Mapping[str, Any]]) -> dict[str, list[int]]:
    """The measured stages, rounded down so that their sum never exceeds the frame."""
    measured = [stage for stage in STAGES if frames[0][stage] is not None]
    return {stage: [math.floor(frame[stage] * MICROSECONDS) for frame in frames] for stage in measured}
