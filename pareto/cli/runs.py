"""python -m pareto runs: one page over many explorations."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable
from pathlib import Path

from groundwork import terminal
from pareto.errors import ScenarioError, StateError
from pareto.measuring.folder import SPACE


def add_arguments(runs: argparse.ArgumentParser) -> None:
    """Add the command's options to its parser."""
    runs.add_argument(
        "folders", nargs="+", type=Path, metavar="FOLDER", help="explorations, or folders that hold some"
    )
    runs.add_argument("--output", type=Path, default=Path("runs.html"), help="the HTML file (runs.html)")
    runs.set_defaults(act=draw)


def draw(options: argparse.Namespace) -> int:
    """Write the page and print its path; a folder that cannot be read is a warning."""
    from pareto.plot.runs import Run, page

    runs = []
    for path in explorations(options.folders):
        try:
            run = Run.read(path)
        except StateError as error:
            terminal.warn(f"{path} is left out: {error}")
        else:
            runs += [run] if run else []
    if not runs:
        raise ScenarioError(f"{', '.join(map(str, options.folders))}: no exploration can be read there")
    options.output.write_text(page(runs, options.output.parent), encoding="utf-8")
    sys.stdout.write(f"{options.output}\n")
    return 0


def explorations(folders: Iterable[Path]) -> list[Path]:
    """Return the folders that hold an exploration: those given, and those below them."""
    found: dict[Path, None] = {}
    for folder in folders:
        if not folder.is_dir():
            raise ScenarioError(f"{folder} is not a folder")
        found |= dict.fromkeys(sorted(path.parent for path in folder.rglob(SPACE)))
    return list(found)
