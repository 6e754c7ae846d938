"""Measuring a configuration by looking it up in a table that was measured before."""

from __future__ import annotations

import csv
from collections.abc import Callable
from functools import lru_cache, partial
from pathlib import Path

from pareto.errors import EvaluationError, ParetoError, ScenarioError
from pareto.objective import Objective, read_values
from pareto.parameter import Parameter
from pareto.space import Configuration, Space

Evaluate = Callable[[Configuration], dict[str, float]]


def from_table(
    path: Path, space: Space, objectives: tuple[Objective, ...], feasible: tuple[str, str] | None = None
) -> Evaluate:
    """Return a function that looks a configuration up in a CSV file with a column a parameter and objective.

    It raises EvaluationError for a configuration that is not in the table, whose values are no numbers, or
    whose `feasible` (column, text when true) says no; the text is compared without case. The first of
    several rows for one configuration counts; rows that the space's constraints forbid are never asked for.
    Raises ScenarioError when the file lacks a column or holds a value that the space does not have.
    """
    rows: dict[tuple[int, ...], dict[str, str]] = {}
    # A table repeats the same few texts over and over: each is understood once.
    read = [
        (parameter.name, lru_cache(maxsize=None)(partial(_position, parameter)))
        for parameter in space.parameters
    ]
    wanted = [
        *space.names,
        *(objective.name for objective in objectives),
        *([feasible[0]] if feasible else []),
    ]
    line = 1
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file, restval="")
            if missing := [name for name in wanted if name not in (reader.fieldnames or [])]:
                raise ScenarioError(f"{path} has no column {missing[0]!r}: it has {reader.fieldnames}")
            for row in reader:
                line = reader.line_num
                rows.setdefault(tuple(position(row[name]) for name, position in read), row)
    except OSError as error:
        raise ScenarioError(f"cannot read the table {path}: {error.strerror}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise ScenarioError(f"{path}, after line {line}, is no CSV file in UTF-8: {error}") from error
    except ScenarioError:
        raise
    except ParetoError as error:
        raise ScenarioError(f"{path}, line {line}: {error}") from error

    def evaluate(configuration: Configuration) -> dict[str, float]:
        row = rows.get(tuple(item.encode(configuration[item.name]) for item in space.parameters))
        if row is None:
            raise EvaluationError("not in the table")
        if feasible:
            require_feasible(feasible, row[feasible[0]])
        try:
            values = {objective.name: float(row[objective.name]) for objective in objectives}
            read_values(objectives, values)
        except ValueError as error:
            raise EvaluationError(f"not a number in the table: {error}") from error
        return values

    return evaluate


def _position(parameter: Parameter, text: str) -> int:
    return parameter.encode(parameter.parse(text))


def require_feasible(feasible: tuple[str, str], answer: object) -> None:
    """Raise EvaluationError unless `answer` reads like the (column, text when true) of `feasible`."""
    column, true_value = feasible
    if str(answer).strip().lower() != true_value.lower():
        raise EvaluationError(f"{column} is {answer}")
