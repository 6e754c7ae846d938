"""Measurements from elsewhere, read from a CSV file or a JSON file of Kernel Tuner."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from pareto.errors import ForbiddenError, ParetoError, ScenarioError
from pareto.fronts.censored import CENSORED, mark_censored
from pareto.fronts.objective import Objective
from pareto.search.frames import columns
from pareto.spaces import kernel_tuner
from pareto.spaces.space import Configuration, Space

Measurement = tuple[Configuration, dict[str, float] | None]
Feasible = tuple[str, str]  # the column that marks feasible measurements, and its text there


def read_measurements(
    path: Path, space: Space, objectives: Sequence[Objective], feasible: Feasible | None = None
) -> list[Measurement]:
    """Return every row of a CSV file with a column for each parameter and objective, in order.

    The values are None where the measurement failed: where a cell is not a finite number, or the row is not
    `feasible`. A failure that the space's constraints forbid is left out. A value is Censored where a column
    `censored` names its objective. Several rows of one configuration are measurements of it, to be averaged.
    Further columns are ignored, so `evaluations.csv` of an exploration is such a file; its infeasible rows
    have no values.

    Raises ScenarioError when the file cannot be read, lacks a column, or holds a configuration that is not
    in the space, or a wrong name in `censored` (the message names the line). Raises ObjectiveError for
    objectives that share a column.
    """
    measurements: list[Measurement] = []
    for line, row in read_rows(path, columns(space, objectives)):
        if feasible and not {feasible[0], "failure"} & row.keys():
            raise ScenarioError(f"{path} has no column {feasible[0]!r}, which marks feasible measurements")
        numbers = read_numbers(path, line, row, [objective.name for objective in objectives])
        failed = any(map(math.isnan, numbers.values()))
        if feasible and feasible[0] in row:
            failed = failed or not is_feasible(feasible, row[feasible[0]])
        try:
            configuration = space.parse(row)
            space.encode(configuration)
        except ParetoError as error:
            if failed and isinstance(error, ForbiddenError):
                continue  # nothing new
            raise ScenarioError(f"{path}, line {line}: {error}") from error
        measurements.append((configuration, None if failed else numbers))
    return measurements


def read_rows(path: Path, wanted: Iterable[str]) -> Iterator[tuple[int, dict[str, str]]]:
    """Yield line number and cells by column of each row of a CSV file that has the `wanted` columns.

    Kernel Tuner's cache and T4 files have a row for each configuration. Where a row is too short its last
    cells are empty. Raises ScenarioError when the file cannot be read, lacks a wanted column or has it more
    than once.
    """
    line = 1
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            if file.read(1) == "{":
                yield from _kernel_tuner_rows(path, wanted)
                return
            file.seek(0)
            reader = csv.DictReader(file, restval="")
            header = list(reader.fieldnames or [])
            for name in wanted:
                if (times := header.count(name)) != 1:
                    many = "more than one" if times else "no"
                    raise ScenarioError(f"{path} has {many} column {name!r}: it has {', '.join(header)}")
            for row in reader:
                line = reader.line_num
                row.pop(None, None)  # cells beyond the header's
                yield line, row
    except OSError as error:
        raise ScenarioError(f"cannot read {path}: {error.strerror}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise ScenarioError(f"{path}, after line {line}, is not a CSV file in UTF-8: {error}") from error


def _kernel_tuner_rows(path: Path, wanted: Iterable[str]) -> Iterator[tuple[int, dict[str, str]]]:
    try:
        rows = kernel_tuner.read_rows(kernel_tuner.parse(path.read_text(encoding="utf-8-sig")))
    except (ValueError, RecursionError) as error:
        raise ScenarioError(f"{path} is neither CSV nor a JSON file of Kernel Tuner: {error}") from error
    except ScenarioError as error:
        raise ScenarioError(f"{path}: {error}") from error
    header = dict.fromkeys(name for row in rows for name in row)
    for name in wanted:
        if name not in header:
            raise ScenarioError(f"{path} has no column {name!r}: it has {', '.join(header)}")
    for number, row in enumerate(rows, 1):
        yield number, dict.fromkeys(header, "") | row


def read_numbers(path: Path, line: int, row: Mapping[str, str], names: Iterable[str]) -> dict[str, float]:
    """Return the numbers of a row by their `names`, NaN where a cell is not finite; bounds are Censored.

    Raises ScenarioError for a name in the column `censored` that is not a column.
    """
    try:
        return mark_censored({name: number(row[name]) for name in names}, row.get(CENSORED, ""), row)
    except ValueError as error:
        raise ScenarioError(f"{path}, line {line}: {error}") from error


def is_feasible(feasible: Feasible, answer: object) -> bool:
    """Return whether `answer` is the text of a feasible measurement, in upper or lower case."""
    return str(answer).strip().lower() == feasible[1].lower()


def number(cell: str) -> float:
    """Return the finite number in a cell, or NaN, which marks a failed measurement."""
    try:
        value = float(cell)
    except ValueError:
        return math.nan
    return value if math.isfinite(value) else math.nan
