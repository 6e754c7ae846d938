"""`surface`: time and error over a grid of two parameters."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from slam.benchmark import Report
from slam.cli.arguments import UsageError, setting, values
from slam.cli.scenes import Commands, add_run_options, measure, merged, open_device, open_scene
from slam.definitions import complete, definition
from slam.reports import page, surface
from slam.reports.relief import Relief


def add(subparsers: Commands) -> None:
    """Add the command and its options to the command line."""
    parser = subparsers.add_parser(
        "surface", help="time and error over a grid of two parameters' values; resumes an interrupted run"
    )
    for axis in ("x", "y"):
        parser.add_argument(f"--{axis}", required=True, metavar="NAME", help="a parameter of the system")
        parser.add_argument(
            f"--{axis}-values", type=values, metavar="A,B,...", help="default: those of the design space"
        )
    parser.add_argument(
        "--rounds", type=int, default=1, metavar="N", help="measure the grid N times, to know the noise (1)"
    )
    parser.add_argument("--set", action="append", default=[], type=setting, metavar="NAME=VALUE")
    parser.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="for surface.csv and surface.html"
    )
    add_run_options(parser)
    parser.set_defaults(execute=_surface)


def _surface(options: argparse.Namespace) -> None:
    parameters = definition(options.system).parameters
    for name in (options.x, options.y):
        if name not in parameters:
            raise UsageError(f"{name!r}: {options.system} has the parameters {', '.join(sorted(parameters))}")
    grid = surface.Grid(
        options.x,
        options.y,
        options.x_values or parameters[options.x].values,
        options.y_values or parameters[options.y].values,
    )
    if options.rounds < 1:
        raise UsageError(f"--rounds {options.rounds}: give 1 or more")
    page.plotly()
    fixed = merged(options.set)
    sequence = open_scene(options)
    if sequence.truth is None:
        raise UsageError(
            f"{sequence.name} has no true trajectory, so there is no error to draw: give --truth FILE"
        )
    session = open_device(options)
    options.out.mkdir(parents=True, exist_ok=True)
    total, done = options.rounds * len(grid.x_values) * len(grid.y_values), 0

    def measured(configuration: Mapping[str, Any]) -> Report:
        nonlocal done
        done += 1
        point = f"{grid.x}={configuration[grid.x]:g} {grid.y}={configuration[grid.y]:g}"
        label = f"run {done} of at most {total}, {point}: "
        return measure(options, configuration, sequence, session, label)

    device = session.device.describe()
    conditions = {
        "system": options.system,
        "sequence": sequence.sha256,
        "frames": options.frames or len(sequence),
        "volume_size": options.volume_size,
        "initial_position": options.initial_position,
        "device": f"{device['name']} {device['driver']}",
    }
    results = surface.measure(
        grid,
        lambda point: complete(options.system, fixed | dict(point)),
        measured,
        conditions,
        options.out / "surface.csv",
        options.rounds,
    )
    title = f"{options.system} on {sequence.name}, {device['name']}"
    page.save(options.out / "surface.html", "Response surface", surface.figures(grid, results, title))
    sys.stdout.write(surface.table(grid, results))
    if options.rounds > 1:
        sys.stdout.write(f"{Relief.of(grid, results['runtime']).describe()}\n\n")
    sys.stdout.write(f"measured {done}, known before {total - done}: {options.out / 'surface.csv'}\n")
    sys.stdout.write(f"drawn in {options.out / 'surface.html'}\n")
