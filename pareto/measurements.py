"""Measurements that were made elsewhere, read from a CSV file."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from pathlib import Path

from pareto.errors import ParetoError, ScenarioError
from pareto.objective import Objective
from pareto.space import Configuration, Space

Measurement = tuple[Configuration, dict[str, float] | None]


def read_measurements(path: Path, space: Space, objectives: Sequence[Objective]) -> list[Measurement]:
    """Return every row of a CSV file with a column for each parameter and objective, in order.

    The values are None where the measurement failed: where a cell is empty, text, or not finite. Further
    columns are ignored, so `evaluations.csv` of an exploration is such a file.

    Raises ScenarioError when the file cannot be read, lacks a column, or holds a configuration that is not
    in the space; the message names the line.
    """
    wanted = [*space.names, *(objective.name for objective in objectives)]
    found: list[Measurement] = []
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file, restval="")
            if missing := [name for name in wanted if name not in (reader.fieldnames or [])]:
                raise ScenarioError(f"{path} has no column {missing[0]!r}: it has {reader.fieldnames}")
            for row in reader:
                try:
                    configuration = {item.name: item.parse(row[item.name]) for item in space.parameters}
                    space.encode(configuration)
                except ParetoError as error:
                    raise ScenarioError(f"{path}, line {reader.line_num}: {error}") from error
                numbers = {objective.name: _number(row[objective.name]) for objective in objectives}
                failed = any(math.isnan(number) for number in numbers.values())
                found.append((configuration, None if failed else numbers))
    except OSError as error:
        raise ScenarioError(f"cannot read {path}: {error.strerror}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise ScenarioError(f"{path} is no CSV file in UTF-8: {error}") from error
    return found


def _number(cell: str) -> float:
    try:
        number = float(cell)
    except ValueError:
        return math.nan
    return number if math.isfinite(number) else math.nan
