"""`python -m slam`: measure configurations, evaluate trajectories, make and convert sequences."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence as Ordered

from groundwork import terminal
from groundwork.command_line import Parser
from slam.cli import compare, datasets, devices, evaluate, plan, reference, run, surface
from slam.cli.arguments import UsageError
from slam.configuration import ConfigurationError
from slam.datasets import SequenceError
from slam.devices.device import DeviceError, NoDeviceError
from slam.isolated import NO_DEVICE, MeasurementError
from slam.reports.page import MissingPlotlyError
from slam.reports.report import ReportError
from slam.reports.surface import SurfaceError
from slam.trajectories.trajectory import TrajectoryError

# Errors that a user can fix: one line on standard error. Anything else is a defect and shows its traceback.
MISTAKES = (
    SequenceError,
    TrajectoryError,
    ConfigurationError,
    DeviceError,
    UsageError,
    ReportError,
    SurfaceError,
    MeasurementError,
    MissingPlotlyError,
    OSError,
)


def make_parser(prog: str = "python -m slam") -> Parser:
    """The parser of every command; what it parses has the command's function as `execute`."""
    parser = Parser.of_program(
        prog, "Measure configurations of dense SLAM, evaluate trajectories, make sequences."
    )
    subparsers = parser.add_subparsers(required=True, metavar="COMMAND")
    for command in (run, compare, surface, evaluate, devices, plan, reference, datasets):
        command.add(subparsers)
    return parser


def main(arguments: Ordered[str] | None = None, prog: str = "python -m slam") -> int:
    """Carry out one command as the program `prog`; its exit code is 2 for a mistake, 3 without a device."""
    options = make_parser(prog).parse_args(arguments)
    try:
        options.execute(options)
        sys.stdout.flush()
    except BrokenPipeError:  # the reader of a pipe has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except MISTAKES as error:
        terminal.fail(" ".join(str(error).split()))
        return NO_DEVICE if isinstance(error, NoDeviceError) else 2
    except KeyboardInterrupt:
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
