"""python -m pareto front: the front of explorations or tables, and the best point for a purpose."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from groundwork import terminal
from pareto.cli.arguments import (
    add_feasible,
    add_objectives,
    count,
    read_feasible,
    read_limits,
    read_objectives,
    read_space,
    split,
)
from pareto.errors import ObjectiveError, ScenarioError
from pareto.fronts.attainment import attainment
from pareto.fronts.censored import censored_names
from pareto.fronts.front import choose, knee, nondominated, signs
from pareto.fronts.objective import Objective
from pareto.measuring.folder import STATE, Folder, table
from pareto.measuring.measurements import is_feasible, read_measurements, read_numbers, read_rows
from pareto.numbers import as_printed
from pareto.search.explorer import Explorer

Point = tuple[dict[str, Any], dict[str, float]]


@dataclass(frozen=True)
class Source:
    """The measurements of one source: points (columns, values by objective) without failures and bounds.

    Where repeats of an exploration differ, the values are the expected ones.
    """

    objectives: list[Objective]
    limits: dict[str, float]
    points: list[Point]
    failed: int


def add_arguments(front: argparse.ArgumentParser) -> None:
    """Add the command's options to its parser."""
    front.add_argument("source", nargs="*", type=Path, help="folders of explorations, or CSV files")
    front.add_argument("--out", type=Path, help="one more exploration's folder")
    front.add_argument(
        "--space",
        type=Path,
        help="the folders' space, where it is not kept beside them; that of CSV files, of which rows of one "
        "configuration are then averaged",
    )
    add_objectives(front, "columns of CSV files; of an exploration, its own by default")
    add_feasible(front)
    front.add_argument("--no-limits", action="store_true", help="not even those of the explorations")
    which = front.add_mutually_exclusive_group()
    which.add_argument(
        "--prefer", metavar="NAME", help="only the point within --limits that is best in this objective"
    )
    which.add_argument("--knee", action="store_true", help="only the point with the best compromise")
    which.add_argument(
        "--attained", type=count, metavar="K", help="what at least K of the sources reach, each one run"
    )
    front.add_argument("--format", choices=["csv", "json"], default="csv")
    front.add_argument("--output", type=Path, help="a file, in place of printing")
    front.set_defaults(act=print_front)


def print_front(options: argparse.Namespace) -> int:
    """Print the front, or write it to --output; an exploration's folder is only read."""
    paths = [*options.source, *([options.out] if options.out else [])]
    if not paths:
        raise ScenarioError("give an exploration's folder, or a CSV file and --objectives")
    if options.no_limits and options.limits:
        raise ScenarioError("--no-limits and --limits contradict each other: give one of them")
    sources = [_read(path, options) for path in paths]
    objectives, limits = sources[0].objectives, sources[0].limits
    for path, source in zip(paths, sources, strict=True):
        if source.objectives != objectives:
            raise ScenarioError(f"{path} has other objectives than {paths[0]}: name them with --objectives")
        if source.limits != limits:
            raise ScenarioError(
                f"{path} has limits {source.limits} and {paths[0]} {limits}: give --limits, or --no-limits"
            )
    points = _select(sources, objectives, limits, options)
    if not points:
        measured, failed = sum(len(item.points) for item in sources), sum(item.failed for item in sources)
        terminal.note(f"no point within the limits: {measured} measured, {failed} failed")
    text = _text(points, objectives, options.format)
    if options.output:
        options.output.write_text(text, encoding="utf-8")
    else:
        sys.stdout.write(text)
    return 0


def read_exploration(path: Path, space: Path | None) -> Explorer:
    """Return the explorer of a folder. Raises ScenarioError where there is none."""
    folder = Folder(path)
    explorer = folder.read(read_space(space)[0] if space else folder.space()) if path.is_dir() else None
    if explorer is None:
        raise ScenarioError(f"{path} holds no exploration: there is no {STATE}")
    return explorer


def _read(path: Path, options: argparse.Namespace) -> Source:
    if path.is_file():
        return _read_table(path, options)
    explorer = read_exploration(path, options.space)
    objectives = read_objectives(options.objectives, options.maximise, explorer.objectives)
    names = {objective.name for objective in explorer.objectives}
    if unknown := [objective.name for objective in objectives if objective.name not in names]:
        raise ObjectiveError(f"{path} did not measure {unknown[0]!r}: it has {', '.join(sorted(names))}")
    limits = {} if options.no_limits else read_limits(options.limits) or explorer.limits
    return _source(explorer, objectives, _known(limits, names))


def _source(explorer: Explorer, objectives: list[Objective], limits: dict[str, float]) -> Source:
    names = [objective.name for objective in explorer.objectives]
    estimates, exact = explorer.estimates(), explorer.history.exact()
    points: list[Point] = [
        (dict(explorer.space.decode(int(index))), dict(zip(names, row, strict=True)))
        for index, row in zip(estimates.indices[exact], estimates.expected[exact].tolist(), strict=True)
    ]
    return Source(objectives, limits, points, len(explorer.history.failed()))


def _read_table(path: Path, options: argparse.Namespace) -> Source:
    objectives = read_objectives(options.objectives, options.maximise, ())
    if not objectives:
        raise ScenarioError(f"{path} is a table: name its objectives with --objectives a,b")
    limits = read_limits(options.limits)
    needed = dict.fromkeys([*(item.name for item in objectives), *limits, *split(options.prefer)])
    space, scenario = read_space(options.space) if options.space else (None, None)
    feasible = read_feasible(options.feasible, scenario)
    if space:
        explorer = Explorer(space, needed)
        for configuration, values in read_measurements(path, space, explorer.objectives, feasible):
            explorer.tell([configuration], [values])
        return _source(explorer, objectives, limits)
    points: list[Point] = []
    failed = 0
    columns = dict.fromkeys([*needed, *(feasible or ())[:1]])
    for line, row in read_rows(path, columns):  # without a space, every row is a point of its own
        numbers = read_numbers(path, line, row, needed)
        infeasible = feasible is not None and not is_feasible(feasible, row[feasible[0]])
        if infeasible or any(map(math.isnan, numbers.values())):
            failed += 1
        elif not censored_names(numbers):
            points.append(({name: cell for name, cell in row.items() if name not in needed}, numbers))
    return Source(objectives, limits, points, failed)


def _select(
    sources: Sequence[Source],
    objectives: Sequence[Objective],
    limits: dict[str, float],
    options: argparse.Namespace,
) -> list[Point]:
    maximised = {objective.name for objective in objectives if objective.maximise}
    upwards = [objective.maximise for objective in objectives]
    names = [objective.name for objective in objectives]
    within = [[point for point in source.points if _keeps(point[1], limits, maximised)] for source in sources]
    if options.attained:
        runs = [_values(points, names) for points in within]
        surface = attainment(runs, options.attained, upwards)
        return [({}, dict(zip(names, row, strict=True))) for row in surface.tolist()]
    points = [point for some in within for point in some]
    if options.prefer and not points:
        # Nothing to choose from: `choose` reports which limit causes it.
        points = [point for source in sources for point in source.points]
    elif options.knee:
        return [points[knee(_values(points, names), upwards)]] if points else []
    else:
        points = _front(points, names, upwards)
    if options.prefer:
        return [choose(points, limits, options.prefer, maximised)]  # type: ignore[list-item]
    return points


def _front(points: list[Point], names: list[str], upwards: list[bool]) -> list[Point]:
    """Return the non-dominated points, by the first objective."""
    values = _values(points, names)
    kept = np.flatnonzero(nondominated(values, upwards))
    signed = values[kept] * signs(upwards, len(names))
    return [points[row] for row in kept[np.lexsort(signed.T[::-1])]]


def _values(points: Sequence[Point], names: list[str]) -> NDArray[np.float64]:
    return np.array([[values[name] for name in names] for _, values in points]).reshape(-1, len(names))


def _text(points: Sequence[Point], objectives: Sequence[Objective], form: str) -> str:
    if form == "json":
        answer = [
            {"configuration": point, "values": {name: as_printed(value) for name, value in values.items()}}
            for point, values in points
        ]
        return json.dumps(answer, indent=2) + "\n"
    # Sources may differ in columns: missing values stay empty.
    names = dict.fromkeys(name for _, values in points for name in values)
    columns = dict.fromkeys(name for point, _ in points for name in point if name not in names)
    header = [*columns, *(names or (objective.name for objective in objectives))]
    rows = [[(point | values).get(name, "") for name in header] for point, values in points]
    return table(header, rows)


def _keeps(values: dict[str, float], limits: dict[str, float], maximised: set[str]) -> bool:
    return all(
        values[name] >= limit if name in maximised else values[name] <= limit
        for name, limit in limits.items()
    )


def _known(limits: dict[str, float], names: set[str]) -> dict[str, float]:
    for name in limits:
        if name not in names:
            raise ObjectiveError(
                f"limit on {name!r}, which was not measured: {', '.join(sorted(names))} were"
            )
    return limits
