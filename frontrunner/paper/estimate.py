"""How many hours the rest of a budget takes on this machine."""

from __future__ import annotations

from pathlib import Path
from statistics import fmean

from frontrunner.paper import published
from frontrunner.paper.budget import SEQUENCE, Study, SurfaceStudy
from pareto.measuring.folder import Folder
from slam.datasets import open_sequence

ENOUGH = 10  # measurements whose own times are better than the shares below
# A random sample's time over the default's, on average over the design space: docs/research/paper.md.
SHARE = {"kfusion": 0.6, "elasticfusion": 1.2}
RUNTIME, MEASURED_IN = -4, -3  # columns of evaluations.csv
WARM_UP = 0.5  # seconds of a run within one process


def study_hours(study: Study, path: Path, references: Path, default: float) -> float:
    """Hours that a search still needs; `default` is the default's seconds a frame.

    Until there are ENOUGH rows the time rests on those of the references. The search may end sooner; without
    a limit it is taken to need as much active learning as the paper's.
    """
    paper = {"kfusion": published.ACTIVE["ODROID-XU3"], "elasticfusion": published.ELASTICFUSION_ACTIVE}
    active = paper[study.system] if study.active is None else study.active
    rows = Folder(path).rows()
    left = max(study.random + active - len(rows), 0)
    if len(rows) >= ENOUGH:
        return left * fmean(float(row[MEASURED_IN]) for row in rows) / 3600
    frames = study.frames or len(open_sequence(SEQUENCE))
    # Reading the sequence, and the start of a process; a first run compiles kernels besides.
    finished = [row for row in Folder(references).rows() if row[RUNTIME]]
    starts = [float(row[MEASURED_IN]) - frames * float(row[RUNTIME]) for row in finished]
    return left * (min(starts) + frames * default * SHARE[study.system]) / 3600


def surface_hours(study: SurfaceStudy, measured: int, default: float) -> float:
    """Hours that the grid still needs, of which `measured` runs are done: most cells cost what the default
    does."""
    frames = study.frames or len(open_sequence(SEQUENCE))
    return max(study.runs - measured, 0) * (WARM_UP + frames * default) / 3600
