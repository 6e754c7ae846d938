"""Measuring a configuration by looking it up in a table that was measured before."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from statistics import fmean

from pareto.errors import EvaluationError, InfeasibleError, ParetoError, ScenarioError
from pareto.fronts.censored import Censored
from pareto.fronts.objective import Objective
from pareto.measuring.measurements import Feasible, is_feasible, read_numbers, read_rows
from pareto.search.frames import columns
from pareto.spaces.space import Configuration, Space

Evaluate = Callable[[Configuration], dict[str, float]]


def from_table(
    path: Path, space: Space, objectives: tuple[Objective, ...], feasible: Feasible | None = None
) -> Evaluate:
    """Return a function that looks a configuration up in a CSV file with a column a parameter and objective.

    It raises EvaluationError for a configuration that is not in the table, whose values are not finite
    numbers, or whose `feasible` (column, text when true) is false; the text is compared without case. Several
    rows of one configuration are measurements of it: the mean of those that did not fail counts, and is
    Censored where one of them is. Rows that the space's constraints forbid are never looked up.

    Raises ScenarioError when the file cannot be read, lacks a column or holds a value that the space does not
    have, and for a parameter of any value; ObjectiveError for objectives that share a column.
    """
    if free := [item.name for item in space.parameters if item.levels]:
        raise ScenarioError(
            f"{path} has few of the values that {free[0]!r} may take: list its values in the space, or "
            "give a count (--levels for a scenario)"
        )
    names = [objective.name for objective in objectives]
    rows: dict[int, list[tuple[dict[str, str], dict[str, float]]]] = {}
    for line, row in read_rows(path, [*columns(space, objectives), *([feasible[0]] if feasible else [])]):
        try:
            index = space.index_of(space.parse(row))
        except ParetoError as error:
            raise ScenarioError(f"{path}, line {line}: {error}") from error
        rows.setdefault(index, []).append((row, read_numbers(path, line, row, names)))

    def evaluate(configuration: Configuration) -> dict[str, float]:
        measured: list[dict[str, float]] = []
        failures = ["not in the table"]
        for row, values in rows.get(space.index_of(configuration), []):
            try:
                measured.append(_checked(row, values, feasible))
            except EvaluationError as error:
                failures.append(str(error))
        if not measured:
            raise EvaluationError(failures[-1])
        return {name: _mean([values[name] for values in measured]) for name in names}

    return evaluate


def _checked(row: dict[str, str], values: dict[str, float], feasible: Feasible | None) -> dict[str, float]:
    if feasible:
        require_feasible(feasible, row[feasible[0]])
    for name, value in values.items():
        if math.isnan(value):
            raise EvaluationError(f"{name} is {row[name]!r} in the table, not a finite number")
    return values


def _mean(values: list[float]) -> float:
    bound = any(isinstance(value, Censored) for value in values)
    return Censored(fmean(values)) if bound else fmean(values)


def require_feasible(feasible: Feasible, answer: object) -> None:
    """Raise InfeasibleError unless `answer` reads like the (column, text when true) of `feasible`."""
    if not is_feasible(feasible, answer):
        raise InfeasibleError(f"{feasible[0]} is {answer}")
