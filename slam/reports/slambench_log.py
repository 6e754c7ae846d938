"""The log of SLAMBench: one line a frame, for scripts that read SLAMBench's."""

from __future__ import annotations

from slam.benchmark import Report
from slam.system import STAGES

TIMES = ("acquisition", *STAGES, "rendering", "computation", "total")
COLUMNS = ("frame", *TIMES, "X", "Y", "Z", "tracked", "integrated")


def log(report: Report) -> str:
    """SLAMBench's columns with their header, separated by tabs.

    Times are seconds, of a stage by the report's `stage_clock`, 0 where it has none. X, Y, Z are metres from
    the camera's start, OpenCV axes (x right, y down, z forward at the start), of the pose after the frame, as
    finally estimated; SLAMBench itself writes the pose before the frame. tracked and integrated are 1 or 0; a
    frame that was skipped or whose tracking was not attempted is 0, as in SLAMBench.
    """
    lines = ["\t".join(COLUMNS)]
    positions = report.poses[:, :3, 3] - report.poses[0, :3, 3]
    for number, (frame, position) in enumerate(zip(report.frames, positions, strict=True)):
        times = frame.to_dict()
        cells = [f"{times[name] or 0.0:.9f}" for name in TIMES] + [f"{value:.9f}" for value in position]
        lines.append(
            "\t".join([str(number), *cells, str(int(frame.tracked is True)), str(int(frame.integrated))])
        )
    return "\n".join(lines) + "\n"
