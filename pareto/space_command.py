"""python -m pareto space: what a space file holds, or what is wrong with it."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from pareto.arguments import count, read_space


def add_space(commands: Any) -> None:
    """Register the command with argparse's `commands`."""
    space = commands.add_parser("space", help="check a space or a HyperMapper scenario and tell its size")
    space.add_argument("file", type=Path, help="JSON")
    space.add_argument("--levels", type=count, help="values of each real parameter of a scenario")
    space.set_defaults(act=describe)


def describe(options: argparse.Namespace) -> int:
    """Print size, parameters with their values and defaults, and constraints."""
    space, scenario = read_space(options.file, options.levels)
    lines = [f"{space.name}: {len(space):,} points"]
    if space.constraints:
        lines[0] += f", of which constraints allow {space.count_allowed()}"
    width = max(map(len, space.names))
    for parameter in space.parameters:
        values = ", ".join(map(str, parameter.values))
        if len(parameter.values) > 12:
            first, last = parameter.values[0], parameter.values[-1]
            values = f"{first} .. {last}, {len(parameter.values)} values"
        lines.append(
            f"  {parameter.name:<{width}}  {parameter.type:<11}  {values}  (default {parameter.default})"
        )
    lines += [f"  constraint: {constraint.text}" for constraint in space.constraints]
    if scenario:
        lines.append(f"  objectives: {', '.join(objective.name for objective in scenario.objectives)}")
    sys.stdout.write("\n".join(lines) + "\n")
    sys.stderr.writelines(f"pareto: {note}\n" for note in (scenario.notes if scenario else ()))
    return 0
