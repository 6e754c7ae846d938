"""`evaluate`: the errors of an estimated trajectory."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from groundwork import terminal
from slam.cli.scenes import Commands, add_truth_axes
from slam.trajectories.evaluation import evaluate
from slam.trajectories.readings import AXES
from slam.trajectories.trajectory import MAXIMAL_STAMP_DIFFERENCE, Trajectory


def add(subparsers: Commands) -> None:
    """Add the command and its options to the command line."""
    parser = subparsers.add_parser("evaluate", help="the errors of an estimated trajectory, as JSON")
    parser.add_argument("--estimate", type=Path, required=True, metavar="FILE")
    parser.add_argument("--truth", type=Path, required=True, metavar="FILE")
    parser.add_argument("--align", choices=("first", "se3", "sim3"), default="first")
    parser.add_argument(
        "--delta", type=int, default=1, metavar="N", help="frames between the poses of the relative error"
    )
    parser.add_argument(
        "--max-difference", type=float, default=MAXIMAL_STAMP_DIFFERENCE, metavar="S", help="between stamps"
    )
    add_truth_axes(parser, AXES[0])
    parser.set_defaults(execute=_evaluate)


def _evaluate(options: argparse.Namespace) -> None:
    estimate, truth = Trajectory.read(options.estimate), Trajectory.read(options.truth)
    axes = options.truth_axes or AXES[0]
    result = evaluate(estimate, truth, options.align, options.delta, options.max_difference, axes)
    for text in result["warnings"]:
        terminal.warn(text)
    sys.stdout.write(json.dumps(result, indent=1) + "\n")
