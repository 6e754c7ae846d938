"""ConfigSpace's JSON files, read into a space and written from one."""

from __future__ import annotations

import itertools
import keyword
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pareto.errors import ScenarioError
from pareto.spaces.constraint import Clause, Constraint
from pareto.spaces.parameter import Parameter, Value
from pareto.spaces.scenario import Scenario, nearest_value
from pareto.spaces.space import Space

WHOLE = 33  # values of an integer on a log scale
MOST_FORBIDDEN = 1000  # clauses that one constraint may become
COMPARISONS = {"EQ": "==", "NEQ": "!=", "LT": "<", "GT": ">", "LE": "<=", "GE": ">="}
RELATIONS = {"LESS": "<", "EQUALS": "==", "GREATER": ">"} | COMPARISONS  # older versions write words


def is_configspace(description: object) -> bool:
    """Return whether a JSON document is a ConfigSpace rather than a space."""
    return isinstance(description, Mapping) and isinstance(description.get("hyperparameters"), list)


def read_configspace(description: Mapping[str, Any], real_count: int | None = None) -> Scenario:
    """Return the space of a ConfigSpace document, without objectives.

    Conditions become conditions, forbidden clauses become constraints. Floats take `real_count` values, or
    any value; integers on a log scale take at most `real_count` values, or WHOLE of them. A default becomes
    the nearest value. `notes` say what was changed or has no effect.

    Raises ScenarioError for what cannot be read, SpaceError for values that are not well formed.
    """
    notes: list[str] = []
    try:
        conditions: dict[str, list[str]] = {}
        for item in description.get("conditions") or ():
            conditions.setdefault(item["child"], []).append(_condition(item))
        parameters, free = [], []
        for item in description["hyperparameters"]:
            texts = conditions.pop(item["name"], [])
            joined = texts[0] if len(texts) == 1 else " and ".join(f"({text})" for text in texts)
            parameters.append(_parameter(item, real_count, notes, joined or None))
            if "default_value" not in item and "default" not in item:
                free.append(item["name"])
        constraints = [text for item in description.get("forbiddens") or () for text in _constraints(item)]
    except (AttributeError, KeyError, TypeError) as error:
        raise ScenarioError(f"this is not a ConfigSpace file: {type(error).__name__} {error}") from error
    if conditions:
        raise ScenarioError(f"a condition is on {next(iter(conditions))!r}, which is not a hyperparameter")
    name = description.get("name") or "space"
    return Scenario(Space(parameters, str(name), constraints, free), objectives=(), notes=tuple(notes))


def write_configspace(space: Space) -> dict[str, Any]:
    """Return `space` as a ConfigSpace document of version 0.4, which ConfigSpace 1 reads.

    Numbers keep the values that they have here: reals with listed values become ordinals. Constraints and
    conditions become lists of values. Raises ScenarioError for one that ConfigSpace cannot express.
    """
    free = {item.name for item in space.parameters if item.levels}
    texts = [(item.text, item.names) for item in space.constraints]
    texts += [
        (item.condition, space.conditions.parents(item.name)) for item in space.parameters if item.condition
    ]
    for text, names in texts:
        if found := free & set(names):
            raise ScenarioError(
                f"{text!r} is about {min(found)!r}, which takes any value, and ConfigSpace lists values "
                "there: give it a count"
            )
    conditions = [
        _written_condition(space, item.name, item.condition) for item in space.parameters if item.condition
    ]
    forbidden = [
        clause
        for constraint in space.constraints
        for part in Constraint(constraint.text, space.parameters).clauses
        for clause in _written_constraint(space, constraint.text, part)
    ]
    return {
        "name": space.name,
        "hyperparameters": [_written_parameter(item) for item in space.parameters],
        "conditions": conditions,
        "forbiddens": forbidden,
        "format_version": 0.4,
    }


def _parameter(
    item: Mapping[str, Any], real_count: int | None, notes: list[str], condition: str | None
) -> Parameter:
    name, kind = item["name"], item["type"]
    default = item.get("default_value", item.get("default"))
    if kind in ("constant", "unparametrized"):
        kind = "categorical" if isinstance(item["value"], (str, bool)) else "ordinal"
        return Parameter(name, kind, (item["value"],), item["value"], condition)
    if kind in ("categorical", "ordinal"):
        return _listed(item, default, notes, condition)
    law, _, number = str(kind).partition("_")
    if law not in ("uniform", "normal", "beta") or number not in ("int", "float"):
        raise ScenarioError(f"hyperparameter {name!r}: type {kind!r} is not known")
    if item.get("lower") is None or item.get("upper") is None:
        raise ScenarioError(f"hyperparameter {name!r} has no bounds: give lower and upper")
    if law != "uniform":
        notes.append(f"{name}: its {law} distribution has no effect: only its bounds count")
    whole = number == "int"
    read: dict[str, Any] = {
        "name": name,
        "type": "integer" if whole else "real",
        "minimum": item["lower"],
        "maximum": item["upper"],
    }
    if item.get("q"):
        read["step"] = item["q"]
    elif not whole or (item.get("log") and item["upper"] - item["lower"] >= (real_count or WHOLE)):
        read["scale"] = "log" if item.get("log") else "linear"
        if whole or real_count:
            read["count"] = real_count or WHOLE
    values = Parameter.from_dict(read).values
    if "count" in read:  # rounded to whole numbers, some of them are equal
        notes.append(f"{name} takes {len(values)} values")
    if default is not None:
        default = nearest_value(name, values, default, notes)
    return Parameter(name, read["type"], values, values[0] if default is None else default, condition)


def _listed(item: Mapping[str, Any], default: Any, notes: list[str], condition: str | None) -> Parameter:
    name, kind = item["name"], item["type"]
    values = tuple(item["choices"] if kind == "categorical" else item["sequence"])
    if item.get("weights") or item.get("probabilities"):
        notes.append(f"{name}: its weights have no effect")
    if kind == "ordinal" and not any(isinstance(value, str) for value in values):
        values = tuple(sorted(values))
    if kind == "categorical" and values and all(isinstance(value, bool) for value in values):
        kind, values = "boolean", tuple(sorted(values))
    default = values[0] if default is None and values else default
    return Parameter(name, kind, values, default, condition)


def _condition(item: Mapping[str, Any]) -> str:
    kind = item["type"]
    if kind in ("AND", "OR"):
        return f" {kind.lower()} ".join(f"({_condition(part)})" for part in item["conditions"])
    return _comparison(kind, item["parent"], item)


def _constraints(item: Mapping[str, Any]) -> list[str]:
    """Return the constraints that express a forbidden clause."""
    if item["type"] == "OR":
        return [text for part in item["clauses"] for text in _constraints(part)]
    return [f"not ({_forbidden(item)})"]


def _forbidden(item: Mapping[str, Any]) -> str:
    kind = item["type"]
    if kind in ("AND", "OR"):
        return f" {kind.lower()} ".join(f"({_forbidden(part)})" for part in item["clauses"])
    if kind.startswith("RELATION"):
        relation = item["lambda"] if kind == "RELATION" else kind.removeprefix("RELATION_")
        if relation not in RELATIONS:
            raise ScenarioError(f"a forbidden relation of type {relation!r} is not known")
        return f"{_name(item['left'])} {RELATIONS[relation]} {_name(item['right'])}"
    return _comparison({"EQUALS": "EQ"}.get(kind, kind.removeprefix("CLAUSE_")), item["name"], item)


def _comparison(kind: str, name: str, item: Mapping[str, Any]) -> str:
    if kind == "IN":
        return f"{_name(name)} in {list(item['values'])!r}"
    if kind not in COMPARISONS:
        raise ScenarioError(f"a condition or forbidden clause of type {kind!r} is not known")
    return f"{_name(name)} {COMPARISONS[kind]} {item['value']!r}"


def _name(name: str) -> str:
    plain = name.isidentifier() and not keyword.iskeyword(name) and name.lower() not in ("true", "false")
    return name if plain else f"`{name}`"


def _written_parameter(item: Parameter) -> dict[str, Any]:
    written: dict[str, Any]
    if item.levels:
        return {
            "type": "uniform_float",
            "name": item.name,
            "lower": item.levels.minimum,
            "upper": item.levels.maximum,
            "log": item.levels.scale == "log",
            "default_value": item.default,
        }
    values = list(item.values)
    if len(values) == 1:
        return {"type": "constant", "name": item.name, "value": values[0]}
    if item.type in ("categorical", "boolean"):
        written = {"type": "categorical", "name": item.name, "choices": values, "weights": None}
    elif item.contiguous:
        written = {"type": "uniform_int", "name": item.name, "lower": values[0], "upper": values[-1]}
        written["log"] = False
    else:
        written = {"type": "ordinal", "name": item.name, "sequence": values}
    return {**written, "default_value": item.default}


def _written_condition(space: Space, child: str, text: str) -> dict[str, Any]:
    alternatives = []
    for clauses in Constraint(text, space.parameters).alternatives:
        values: dict[str, list[Value]] = {}
        for clause in clauses:
            if len(clause.names) > 1:
                raise ScenarioError(
                    f"the condition of {child!r}, {text!r}, joins {' and '.join(clause.names)} in a way that "
                    "ConfigSpace cannot express: use comparisons of one parameter each, joined by and, or"
                )
            [parent] = clause.names
            kept = _values_where(space, clause)
            values[parent] = [value for value in values.get(parent, kept) if value in kept]
        parts = [
            {"type": "IN", "child": child, "parent": parent, "values": kept}
            for parent, kept in values.items()
        ]
        if not all(part["values"] for part in parts):
            continue  # it never holds
        joined = {"type": "AND", "child": child, "conditions": parts}
        alternatives.append(parts[0] if len(parts) == 1 else joined)
    if not alternatives:
        raise ScenarioError(f"the condition of {child!r}, {text!r}, never holds")
    if len(alternatives) == 1:
        return alternatives[0]
    return {"type": "OR", "child": child, "conditions": alternatives}


def _written_constraint(space: Space, text: str, clause: Clause) -> list[dict[str, Any]]:
    """Return forbidden clauses: for each combination of all parameters but one, the values of that one."""
    parameters = {item.name: item for item in space.parameters}
    *others, last = sorted(clause.names, key=lambda name: len(parameters[name].values))
    count = math.prod(len(parameters[name].values) for name in others)
    if count > MOST_FORBIDDEN:
        raise ScenarioError(
            f"the constraint {text!r} would become up to {count:,} forbidden clauses of ConfigSpace, which "
            f"knows no arithmetic: at most {MOST_FORBIDDEN:,} are written"
        )
    written = []
    for combination in itertools.product(*(parameters[name].values for name in others)):
        fixed = dict(zip(others, combination, strict=True))
        codes = {name: np.array([parameters[name].encode(value)]) for name, value in fixed.items()}
        holds = clause.holds({**codes, last: np.arange(len(parameters[last].values))})
        kept = np.broadcast_to(holds, (len(parameters[last].values),))
        broken = [value for value, keeps in zip(parameters[last].values, kept, strict=True) if not keeps]
        if not broken:
            continue
        parts: list[dict[str, Any]] = [
            {"type": "EQUALS", "name": name, "value": value} for name, value in fixed.items()
        ]
        parts.append({"type": "IN", "name": last, "values": broken})
        written.append(parts[0] if len(parts) == 1 else {"type": "AND", "clauses": parts})
    return written


def _values_where(space: Space, clause: Clause) -> list[Value]:
    [name] = clause.names
    values: Sequence[Value] = next(item.values for item in space.parameters if item.name == name)
    kept = np.broadcast_to(clause.holds({name: np.arange(len(values))}), (len(values),))
    return [value for value, keeps in zip(values, kept, strict=True) if keeps]
