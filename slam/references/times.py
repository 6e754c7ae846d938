"""Times of a front's configurations on the clients' sequence, relative to its default.

An exploration times them over several sequences, most of them once. Predictions for other devices need
comparable times: on the same sequence, each relative to the default.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from statistics import median
from typing import Any

from slam.isolated import Measurement, measure
from slam.system import STAGES

DEFAULT = "default"
ROUNDS, EVERY = 3, 8
DECIMALS = 6

Progress = Callable[[int, int], object]  # called with how many runs are done, and how many there are
Measure = Callable[..., Measurement]


def on_sequence(
    points: Mapping[str, Mapping[str, Any]],
    sequence: Path,
    frames: int,
    rounds: int = ROUNDS,
    progress: Progress | None = None,
    measure: Measure = measure,
) -> tuple[dict[str, dict[str, Any]], str]:
    """Medians over ROUNDS by the name of the point: `runtime_ratio`, the mean time of a counted frame, and
    `stages`, that of each stage, both over the runtime of the default that ran last. It runs again before
    every EVERY points. Besides, the device that measured.

    POINTS: parameters of KinectFusion by name, the default among them. Each runs over the first FRAMES of
    SEQUENCE in a process of its own, on the best OpenCL device here. Raises what `slam.isolated.measure`
    raises.
    """
    found: dict[str, list[tuple[float, dict[str, float]]]] = {name: [] for name in points}
    order = _with_default([name for name in points if name != DEFAULT]) * rounds
    default = 0.0
    for number, name in enumerate(order, start=1):
        measured = measure("kfusion", points[name], [sequence], frames=frames)
        runtime = measured.objectives["runtime"]
        default = runtime if name == DEFAULT else default
        stages = {stage: measured.stages[stage] / default for stage in STAGES if stage in measured.stages}
        found[name].append((runtime / default, stages))
        if progress is not None:
            progress(number, len(order))
    times = {
        name: {
            "runtime_ratio": round(median(ratio for ratio, _ in runs), DECIMALS),
            "stages": {
                stage: round(median(stages[stage] for _, stages in runs), DECIMALS) for stage in runs[0][1]
            },
        }
        for name, runs in found.items()
    }
    return times, f"{measured.device['name']}, driver {measured.device['driver']}"


def _with_default(names: list[str]) -> list[str]:
    """NAMES with the default before every EVERY of them."""
    parts = [names[place : place + EVERY] for place in range(0, max(len(names), 1), EVERY)]
    return [name for part in parts for name in (DEFAULT, *part)]
