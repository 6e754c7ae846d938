"""python -m pareto transfer: another device's front, ordered by the values expected on this one."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from pareto.cli.arguments import (
    add_feasible,
    add_objectives,
    count,
    read_feasible,
    read_limits,
    read_space,
    required_objectives,
)
from pareto.devices.zero_shot import expected_points
from pareto.measuring.folder import table
from pareto.measuring.measurements import read_measurements


def add_arguments(transfer: argparse.ArgumentParser) -> None:
    """Add the command's options to its parser."""
    transfer.add_argument("source", type=Path, metavar="CSV", help="what the other device measured")
    transfer.add_argument("--here", type=Path, metavar="CSV", help="what was measured on this device")
    transfer.add_argument(
        "--space", type=Path, required=True, help="a space, or a HyperMapper scenario, as JSON"
    )
    add_objectives(transfer, "names, separated by commas; a scenario brings its own")
    add_feasible(transfer)
    transfer.add_argument("--prefer", help="the objective to order by (the first)")
    transfer.add_argument("--count", type=count, help="take this many, front after front (the front)")
    transfer.set_defaults(act=print_expected)


def print_expected(options: argparse.Namespace) -> int:
    """Print the configurations as CSV: expected values here, values there, measured here, within limits."""
    space, scenario = read_space(options.space)
    objectives = required_objectives(options, scenario)
    feasible = read_feasible(options.feasible, scenario)
    promises = expected_points(
        space,
        objectives,
        read_measurements(options.source, space, objectives, feasible),
        read_measurements(options.here, space, objectives, feasible) if options.here else (),
        prefer=options.prefer,
        limits=read_limits(options.limits),
        count=options.count,
    )
    names = [objective.name for objective in objectives]
    header = [*space.names, *names, *(f"source_{name}" for name in names), "measured", "within_limits"]
    rows = [
        [
            *promise.configuration.values(),
            *promise.expected.values(),
            *promise.source.values(),
            int(promise.measured),
            int(promise.within),
        ]
        for promise in promises
    ]
    sys.stdout.write(table(header, rows))
    return 0
