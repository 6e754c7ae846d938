"""python -m pareto plot: the pictures of an exploration."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from pareto.cli.arguments import add_units, read_units
from pareto.cli.front import read_exploration
from pareto.errors import ScenarioError


def add_arguments(plot: argparse.ArgumentParser) -> None:
    """Add the command's options to its parser."""
    plot.add_argument("source", nargs="?", type=Path, help="the exploration's folder")
    plot.add_argument("--out", type=Path, help="the same, as explore calls it")
    plot.add_argument("--space", type=Path, help="its space, where it is not kept in the folder")
    plot.add_argument("--output", type=Path, help="the HTML file; front.html in the folder by default")
    add_units(plot)
    plot.set_defaults(act=draw)


def draw(options: argparse.Namespace) -> int:
    """Write the page and print its path."""
    from pareto.plot import save

    path = options.source or options.out
    if path is None:
        raise ScenarioError("plot what? Give an exploration's folder")
    target = options.output or path / "front.html"
    explorer = read_exploration(path, options.space)
    save(explorer, target, read_units(options.units, explorer.objectives))
    sys.stdout.write(f"{target}\n")
    return 0
