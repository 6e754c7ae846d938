"""The whole command with a small budget: `python -m tests.frontrunner.paper.tiny DIR`."""

import sys
from pathlib import Path

from frontrunner.paper.budget import Budget, Study, SurfaceStudy
from frontrunner.paper.command import repeat_paper
from slam.reports.surface import Grid

FRAMES = 6  # the fewest in which KinectFusion tracks
TINY = Budget(
    Study("kfusion", random=4, batch=1, iterations=1, frames=FRAMES),
    Study("elasticfusion", random=2, batch=1, iterations=1, frames=FRAMES),
    SurfaceStudy(Grid("mu", "icp_threshold", (0.1, 0.4), (1e-4, 1.0)), rounds=2, frames=FRAMES),
)

if __name__ == "__main__":
    repeat_paper(Path(sys.argv[1]), "tiny", TINY)
