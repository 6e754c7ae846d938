"""python -m pareto space: describe, check and convert a space file."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from groundwork import terminal
from pareto.cli.arguments import count, read_objectives, read_space
from pareto.errors import ScenarioError
from pareto.spaces.configspace import write_configspace
from pareto.spaces.hypermapper import write_hypermapper
from pareto.spaces.scenario import Scenario
from pareto.spaces.space import Space

FORMATS = ("frontrunner", "hypermapper", "configspace")


def add_arguments(space: argparse.ArgumentParser) -> None:
    """Add the command's options to its parser."""
    space.add_argument("file", type=Path, help="JSON: a space, a HyperMapper scenario or a ConfigSpace")
    space.add_argument("--levels", type=count, help="values of each real parameter of a scenario (any)")
    space.add_argument("--to", choices=FORMATS, help="print the space in this format instead")
    space.add_argument("--objectives", help="names for a HyperMapper scenario, separated by commas")
    space.add_argument("--maximise", default="", help="those of the objectives that are maximised")
    space.add_argument("--output", type=Path, help="a file, in place of printing")
    space.set_defaults(act=run)


def run(options: argparse.Namespace) -> int:
    """Describe the space, or convert it where --to says so."""
    space, scenario = read_space(options.file, options.levels)
    notes = list(scenario.notes) if scenario else []
    if options.to:
        text = _converted(space, scenario, options, notes)
    elif options.output or options.objectives:
        raise ScenarioError("--output and --objectives are for --to FORMAT")
    else:
        text = _described(space, scenario)
    if options.output:
        options.output.write_text(text, encoding="utf-8")
    else:
        sys.stdout.write(text)
    for note in notes:
        terminal.note(note)
    return 0


def _converted(space: Space, scenario: Scenario | None, options: argparse.Namespace, notes: list[str]) -> str:
    if options.to == "configspace":
        description = write_configspace(space)
    elif options.to == "hypermapper":
        otherwise = scenario.objectives if scenario else ()
        objectives = read_objectives(options.objectives, options.maximise, otherwise)
        description, more = write_hypermapper(space, objectives)
        notes += more
    else:
        description = space.to_dict()
    return json.dumps(description, indent=2) + "\n"


def _described(space: Space, scenario: Scenario | None) -> str:
    """Return size, parameters with their values and defaults, and constraints."""
    lines = [f"{space.name}: {len(space):,} points"]
    if space.clauses:
        kinds = [name for name in ("constraints", "conditions") if getattr(space, name)]
        lines[0] += f", of which {' and '.join(kinds)} allow {space.count_allowed()}"
    width = max(map(len, space.names))
    for parameter in space.parameters:
        first, last, size = parameter.values[0], parameter.values[-1], len(parameter.values)
        if parameter.levels:
            values = f"any value of {first} .. {last}" + " (log)" * (parameter.levels.scale == "log")
        elif size > 12:
            values = f"{first} .. {last}, {size} values"
        else:
            values = ", ".join(map(str, parameter.values))
        chosen = ", chosen" if parameter.name in space.defaults_chosen else ""
        condition = f"  if {parameter.condition}" if parameter.condition else ""
        default = f"(default {parameter.default}{chosen}){condition}"
        lines.append(f"  {parameter.name:<{width}}  {parameter.type:<11}  {values}  {default}")
    lines += [f"  constraint: {constraint.text}" for constraint in space.constraints]
    if scenario and scenario.objectives:
        lines.append(f"  objectives: {', '.join(objective.name for objective in scenario.objectives)}")
    return "\n".join(lines) + "\n"
