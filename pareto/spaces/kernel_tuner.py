"""Kernel Tuner's JSON files: the space of a T1 or cache file, and the rows of a cache or T4 file."""

from __future__ import annotations

import ast
import json
import operator
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from pareto.errors import ScenarioError
from pareto.fronts.objective import Objective
from pareto.numbers import is_finite
from pareto.spaces.parameter import Parameter, Value
from pareto.spaces.scenario import Scenario
from pareto.spaces.space import Space
from pareto.spaces.value_ranges import MOST_VALUES

KINDS = {"int": "ordinal", "uint": "ordinal", "float": "ordinal", "bool": "boolean", "string": "categorical"}
FAILED = 1e20  # the time that old cache files give to a failed configuration
MORE_IS_BETTER = ("/s", "/W", "/J")  # ends of the names of rates


def parse(text: str) -> Any:
    """Return the JSON document in `text`; a cache file that was never closed is closed first.

    Raises ValueError for anything else.
    """
    try:
        return json.loads(text)
    except ValueError:
        return json.loads(text.rstrip().rstrip(",") + "}}")


def is_kernel_tuner(document: object) -> bool:
    """Return whether it is one of these files."""
    return isinstance(document, Mapping) and bool(
        {"ConfigurationSpace", "tune_params", "results"} & document.keys()
    )


def read_space(document: Mapping[str, Any]) -> Scenario:
    """Return the space, and the objective of a cache file.

    A T1 file writes values as Python: lists, ranges and comprehensions are read, nothing is executed. Its
    conditions become constraints. A cache file has none. Raises ScenarioError or SpaceError.
    """
    if "results" in document:
        raise ScenarioError("this T4 file has results: the space is in the T1 or cache file")
    try:
        if "ConfigurationSpace" not in document:
            return _of_cache(document)
        described = document["ConfigurationSpace"]
        parameters = [
            _parameter(item["Name"], _values(item), KINDS.get(item["Type"]), item.get("Default"))
            for item in described["TuningParameters"]
        ]
        constraints = [item["Expression"] for item in described.get("Conditions") or ()]
        kernel = document.get("KernelSpecification") or {}
        free = [item["Name"] for item in described["TuningParameters"] if "Default" not in item]
        name = str(kernel.get("KernelName") or "kernel")
        return Scenario(Space(parameters, name, constraints, free), objectives=())
    except (AttributeError, KeyError, TypeError) as error:
        raise ScenarioError(f"this is not a file of Kernel Tuner: {type(error).__name__} {error}") from error


def read_rows(document: object) -> list[dict[str, str]]:
    """Return a row of texts by column for each configuration; one that failed lacks its measurements.

    Raises ScenarioError for what is neither a cache file nor a T4 file.
    """
    try:
        if isinstance(document, Mapping) and isinstance(document.get("cache"), Mapping):
            return [_row(entry) for entry in document["cache"].values()]
        if isinstance(document, Mapping) and isinstance(document.get("results"), list):
            return [_row(_t4_entry(result)) for result in document["results"]]
    except (AttributeError, KeyError, TypeError) as error:
        raise ScenarioError(f"this is not a file of Kernel Tuner: {type(error).__name__} {error}") from error
    raise ScenarioError(
        "this JSON file has no measurements: give a CSV file, or Kernel Tuner's cache or T4 file"
    )


def _of_cache(document: Mapping[str, Any]) -> Scenario:
    parameters = [_parameter(name, values) for name, values in document["tune_params"].items()]
    space = Space(
        parameters, str(document.get("kernel_name") or "kernel"), movable=tuple(document["tune_params"])
    )
    name = document.get("objective")
    if not isinstance(name, str):
        return Scenario(space, objectives=())
    objective = Objective(name, maximise=name.endswith(MORE_IS_BETTER))
    aim = "maximised" if objective.maximise else "minimised"
    return Scenario(space, (objective,), notes=(f"the file's objective {name} is {aim}",))


def _parameter(
    name: str, values: Sequence[Value], kind: str | None = None, default: Value | None = None
) -> Parameter:
    if kind is None:
        truths = all(isinstance(value, bool) for value in values)
        numbers = not any(isinstance(value, (bool, str)) for value in values)
        kind = "boolean" if truths else "ordinal" if numbers else "categorical"
    if kind == "boolean":
        values = [bool(value) for value in values]
    values = values if kind == "categorical" else sorted(values)
    read = {"name": name, "type": kind, "values": list(dict.fromkeys(values))}
    return Parameter.from_dict(read if default is None else {**read, "default": default})


def _t4_entry(result: Mapping[str, Any]) -> dict[str, Any]:
    worked = result.get("invalidity", "correct") == "correct" and bool(result.get("correctness", 1))
    measured = {item["name"]: item["value"] for item in result.get("measurements") or () if worked}
    return {**measured, **result["configuration"]}


def _row(entry: Mapping[str, Any]) -> dict[str, str]:
    return {
        name: "" if value is None or value == FAILED else str(value)
        for name, value in entry.items()
        if not isinstance(value, (list, Mapping))
    }


def _values(item: Mapping[str, Any]) -> list[Value]:
    """Return the values that a T1 file writes as a list or as Python."""
    written = item["Values"]
    if isinstance(written, str):
        try:
            written = _evaluate(ast.parse(written.strip(), mode="eval").body, {})
        except (SyntaxError, ValueError, ArithmeticError, RecursionError) as error:
            raise ScenarioError(f"parameter {item['Name']!r}: values {written!r:.80}: {error}") from error
    if not isinstance(written, (list, tuple, range)):
        raise ScenarioError(f"parameter {item['Name']!r}: values {written!r:.80} are not a list")
    return list(written)


def _evaluate(node: ast.expr, names: Mapping[str, Any]) -> Any:
    """Return the value of literals, arithmetic, `range`, `list` and a comprehension over one name."""
    match node:
        case ast.Constant(value=bool() | int() | float() | str() as value):
            return value
        case ast.Name(id=name) if name in names:
            return names[name]
        case ast.List(elts=items) | ast.Tuple(elts=items):
            return [_evaluate(item, names) for item in items]
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return -_number(operand, names)
        case ast.BinOp(op=sign, left=left, right=right) if type(sign) in _ARITHMETIC:
            first, second = _number(left, names), _number(right, names)
            if isinstance(sign, ast.Pow) and abs(second) > 64:
                raise ValueError(f"the power {ast.unparse(node)} is too large")
            result = _ARITHMETIC[type(sign)](first, second)
            if not is_finite(result):
                raise ValueError(f"{ast.unparse(node)} is too large")
            return result
        case ast.Call(func=ast.Name(id="range"), args=arguments, keywords=[]):
            span = range(*(_evaluate(argument, names) for argument in arguments))
            if len(span) > MOST_VALUES:
                raise ValueError(f"{ast.unparse(node)} has more than {MOST_VALUES:,} values")
            return span
        case ast.Call(func=ast.Name(id="list" | "sorted"), args=[argument], keywords=[]):
            return list(_evaluate(argument, names))
        case ast.ListComp(
            elt=item, generators=[ast.comprehension(target=ast.Name(id=name), iter=source, ifs=[])]
        ) if not any(isinstance(part, _LISTS) for part in ast.walk(item)):
            return [_evaluate(item, {**names, name: value}) for value in _evaluate(source, names)]
    raise ValueError(f"{ast.unparse(node)!r} is not understood: write a list such as [16, 32, 64]")


def _number(node: ast.expr, names: Mapping[str, Any]) -> Any:
    value = _evaluate(node, names)
    if not isinstance(value, (int, float)):
        raise ValueError(f"{ast.unparse(node)!r} is not a number")
    return value


_LISTS = (ast.Call, ast.List, ast.ListComp, ast.Tuple)
_ARITHMETIC: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv,
    ast.Mod: operator.mod,
    ast.Pow: operator.pow,
}
