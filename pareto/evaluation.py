"""Measuring a configuration from the command line: by looking it up in a table, or by running a program."""

from __future__ import annotations

import csv
import json
import shlex
import subprocess
from collections.abc import Callable
from pathlib import Path

from pareto.errors import EvaluationError, ObjectiveError, ParetoError, ScenarioError
from pareto.objective import Objective, read_values
from pareto.space import Configuration, Space

Evaluate = Callable[[Configuration], dict[str, float]]


def from_table(
    path: Path, space: Space, objectives: tuple[Objective, ...], feasible: tuple[str, str] | None = None
) -> Evaluate:
    """Return a function that looks a configuration up in a CSV file with a column a parameter and objective.

    It raises EvaluationError for a configuration that is not in the table, whose values are no numbers, or
    whose `feasible` (column, text when true) says no; the text is compared without case. The first of
    several rows for one configuration counts. Raises ScenarioError when the file lacks a column or holds a
    value that the space does not have.
    """
    rows: dict[int, dict[str, str]] = {}
    wanted = [
        *space.names,
        *(objective.name for objective in objectives),
        *([feasible[0]] if feasible else []),
    ]
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file)
            if missing := [name for name in wanted if name not in (reader.fieldnames or [])]:
                raise ScenarioError(f"{path} has no column {missing[0]!r}: it has {reader.fieldnames}")
            for row in reader:
                values = {
                    parameter.name: parameter.parse(row[parameter.name]) for parameter in space.parameters
                }
                rows.setdefault(space.encode(values), row)
    except OSError as error:
        raise ScenarioError(f"cannot read the table {path}: {error.strerror}") from error
    except ScenarioError:
        raise
    except ParetoError as error:
        raise ScenarioError(f"{path}, line {reader.line_num}: {error}") from error

    def evaluate(configuration: Configuration) -> dict[str, float]:
        row = rows.get(space.encode(configuration))
        if row is None:
            raise EvaluationError("not in the table")
        if feasible and row[feasible[0]].strip().lower() != feasible[1].lower():
            raise EvaluationError(f"{feasible[0]} is {row[feasible[0]]}")
        try:
            values = {objective.name: float(row[objective.name]) for objective in objectives}
            read_values(objectives, values)
        except (ValueError, TypeError) as error:
            raise EvaluationError(f"not a number in the table: {error}") from error
        return values

    return evaluate


def from_command(command: str, objectives: tuple[Objective, ...], timeout: float | None = None) -> Evaluate:
    """Return a function that runs `command` and reads its last line of output, a JSON object, for values.

    The command is split like a shell would, without a shell; `{config}` in an argument becomes the
    configuration as JSON, `{name}` the value of that parameter. The function raises EvaluationError with the
    reason when the program fails, takes longer than `timeout` seconds or prints no values. Raises
    ScenarioError for a command that cannot be split.
    """
    try:
        arguments = shlex.split(command)
    except ValueError as error:
        raise ScenarioError(f"--command {command!r}: {error}") from error
    if not arguments:
        raise ScenarioError("--command is empty")

    def evaluate(configuration: Configuration) -> dict[str, float]:
        fields = {
            "config": json.dumps(configuration),
            **{name: str(value) for name, value in configuration.items()},
        }
        filled = [_fill(argument, fields) for argument in arguments]
        try:
            ended = subprocess.run(filled, capture_output=True, text=True, timeout=timeout, check=False)
        except subprocess.TimeoutExpired:
            raise EvaluationError(f"no answer after {timeout:g} s") from None
        except OSError as error:
            raise EvaluationError(f"cannot run {filled[0]}: {error.strerror}") from error
        if ended.returncode != 0:
            last = (ended.stderr.strip().splitlines() or ["nothing on its error output"])[-1]
            raise EvaluationError(f"exit code {ended.returncode}: {last[:300]}")
        last = (ended.stdout.strip().splitlines() or [""])[-1]
        try:
            answer = json.loads(last)
            return dict(zip((item.name for item in objectives), read_values(objectives, answer), strict=True))
        except (ObjectiveError, ValueError) as error:
            raise EvaluationError(f"its last line is no JSON with the objectives: {error}") from error

    return evaluate


def _fill(argument: str, fields: dict[str, str]) -> str:
    # One pass from left to right: a value that itself contains braces must not be filled in again.
    parts, rest = [], argument
    while rest:
        at = {rest.find("{" + name + "}"): name for name in fields if "{" + name + "}" in rest}
        if not at:
            break
        start = min(at)
        parts += [rest[:start], fields[at[start]]]
        rest = rest[start + len(at[start]) + 2 :]
    return "".join([*parts, rest])
