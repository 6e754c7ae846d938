"""The response surface of KinectFusion, in rounds and within one process."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from frontrunner.paper.budget import SEQUENCE, SurfaceStudy
from groundwork.terminal import progress_line
from pareto.measuring.folder import EVALUATIONS
from slam.benchmark import Report, run
from slam.datasets import open_sequence
from slam.definitions import complete
from slam.devices.choice import choose_device
from slam.registry import open_session
from slam.reports import surface
from slam.reports.relief import Relief

SYSTEM = "kfusion"


@dataclass(frozen=True)
class Surface:
    """The measured grid: "runtime" and "ate_max" as (rounds, y, x) arrays, and what is sure of the times."""

    study: SurfaceStudy
    measured: Mapping[str, NDArray[np.float64]]
    relief: Relief


def known_runs(folder: Path) -> int:
    """The number of runs that a folder has already."""
    path = folder / EVALUATIONS
    return max(path.read_text(encoding="utf-8").count("\n") - 1, 0) if path.exists() else 0


def measure_surface(study: SurfaceStudy, folder: Path) -> Surface:
    """Measure what `folder` lacks of the grid."""
    sequence = open_sequence(SEQUENCE)
    session = open_session(SYSTEM, choose_device(None))
    progress = progress_line("response surface: ", "run")
    done = known_runs(folder)

    def measured(configuration: Mapping[str, Any]) -> Report:
        nonlocal done
        report = run(configuration, sequence, system=SYSTEM, frames=study.frames, device=session)
        done += 1
        if progress:
            progress(done, study.runs)
        return report

    folder.mkdir(parents=True, exist_ok=True)
    setting = {"system": SYSTEM, "sequence": sequence.sha256, "frames": study.frames or len(sequence)}
    results = surface.measure(
        study.grid,
        lambda point: complete(SYSTEM, point),
        measured,
        setting,
        folder / EVALUATIONS,
        study.rounds,
    )
    return Surface(study, results, Relief.of(study.grid, results["runtime"]))
