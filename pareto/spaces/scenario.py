"""HyperMapper scenario files, read into a space, objectives and budgets."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pareto.errors import ScenarioError
from pareto.fronts.objective import Objective, read_objectives
from pareto.numbers import is_number
from pareto.spaces.parameter import Parameter, Value
from pareto.spaces.scenario_fields import SECTIONS, notes_on
from pareto.spaces.space import Space
from pareto.spaces.value_ranges import Levels


@dataclass(frozen=True)
class Scenario:
    """The content of a scenario file; a file that describes only a space has no objectives.

    `feasible` is the column that marks feasible evaluations, and the text it then holds; `initial` and
    `iterations` are the evaluations before learning begins and the rounds after it, of `batch` evaluations
    each, and `table` the file of an exhaustive search; None where not given. `notes` are sentences on what
    was changed or has no effect here.
    """

    space: Space
    objectives: tuple[Objective, ...]
    feasible: tuple[str, str] | None = None
    initial: int | None = None
    iterations: int | None = None
    batch: int | None = None
    table: str | None = None
    notes: tuple[str, ...] = ()

    @property
    def budget(self) -> int | None:
        """Evaluations in all, None unless both `initial` and `iterations` are given."""
        if self.initial is None or self.iterations is None:
            return None
        return self.initial + self.iterations * (self.batch or 1)

    @classmethod
    def load(cls, path: str | Path, real_count: int | None = None) -> Scenario:
        """Read a HyperMapper JSON file; see `from_dict`."""
        try:
            description = json.loads(Path(path).read_text(encoding="utf-8"))
        except OSError as error:
            raise ScenarioError(f"cannot read the scenario {path}: {error.strerror}") from error
        except ValueError as error:
            raise ScenarioError(f"{path} is not JSON: {error}") from error
        return cls.from_dict(description, real_count=real_count)

    @classmethod
    def from_dict(cls, description: Mapping[str, Any], real_count: int | None = None) -> Scenario:
        """Read the problem's description; settings of HyperMapper itself become `notes`.

        Real parameters take any value, or `real_count` values, evenly spaced, or on a log scale where their
        `transform` is "log"; a real default becomes the nearest of them. A parameter without a default takes
        its middle value, or an allowed one near it, since HyperMapper's users leave the default out when they
        have no better guess. Constraints of a parameter (of HyperMapper's later versions) become constraints
        of the space.

        Raises ScenarioError when parameters or objectives are missing or of an unknown type, SpaceError when
        a parameter's values or constraints are not well formed.
        """
        if not is_scenario(description):
            raise ScenarioError("a scenario has input_parameters and optimization_objectives")
        inputs = description["input_parameters"]
        if not isinstance(inputs, Mapping) or not inputs:
            raise ScenarioError("input_parameters must map names to parameters")
        objectives = description["optimization_objectives"]
        if not isinstance(objectives, list) or not all(isinstance(name, str) for name in objectives):
            raise ScenarioError(f"optimization_objectives must be a list of names, not {objectives!r}")
        for name, item in inputs.items():
            if not isinstance(item, Mapping):
                raise ScenarioError(f"input parameter {name!r} must have a type and values, not {item!r}")
        design, feasible, mode = (_section(description, field) for field in SECTIONS)
        notes = notes_on(description)
        reals = [name for name, item in inputs.items() if item.get("parameter_type") == "real"]
        if reals and real_count:
            notes.append(f"real parameters take {real_count} values: {', '.join(reals)}")
        parameters = [
            _parameter(name, {**_shared_normal(description, place, len(inputs)), **item}, real_count, notes)
            for place, (name, item) in enumerate(inputs.items())
        ]
        title = str(description.get("application_name") or "scenario")
        return cls(
            space=_space(parameters, inputs, title, notes),
            objectives=read_objectives(objectives),
            feasible=_feasible(feasible),
            initial=_count(design.get("number_of_samples"), "number_of_samples"),
            iterations=_count(description.get("optimization_iterations"), "optimization_iterations"),
            batch=_count(
                description.get("evaluations_per_optimization_iteration"),
                "evaluations_per_optimization_iteration",
            ),
            table=_table(mode.get("exhaustive_search_file")),
            notes=tuple(notes),
        )


def is_scenario(description: object) -> bool:
    """Return whether a JSON document is a HyperMapper scenario rather than a space."""
    return isinstance(description, Mapping) and {"input_parameters", "optimization_objectives"} <= set(
        description
    )


def _space(parameters: list[Parameter], inputs: Mapping[str, Any], title: str, notes: list[str]) -> Space:
    constraints: list[str] = []
    for name, item in inputs.items():
        added = item.get("constraints") or []
        if not isinstance(added, list):
            raise ScenarioError(f"input parameter {name!r}: constraints are a list of texts, not {added!r}")
        constraints += added
    free = [name for name, item in inputs.items() if "parameter_default" not in item]
    space = Space(parameters, title, constraints, movable=free)
    if moved := [item.name for item in parameters if space.default[item.name] != item.default]:
        notes.append(f"constraints forbid the middle of {', '.join(moved)}: a value near it is the default")
    return space


def _parameter(name: str, item: Mapping[str, Any], real_count: int | None, notes: list[str]) -> Parameter:
    kind, values = item.get("parameter_type"), item.get("values")
    if kind not in ("real", "integer", "ordinal", "categorical"):
        raise ScenarioError(
            f"input parameter {name!r}: type {kind!r} is not real, integer, ordinal or categorical"
        )
    if not isinstance(values, list) or not values:
        raise ScenarioError(f"input parameter {name!r} needs a list of values, not {values!r}")
    read: dict[str, Any] = {"name": name, "type": kind}
    if kind in ("integer", "real"):
        if len(values) != 2:
            raise ScenarioError(f"input parameter {name!r}: values must be [minimum, maximum], not {values}")
        read |= {"minimum": values[0], "maximum": values[1]}
        if kind == "real":
            read["scale"] = "log" if item.get("transform") == "log" else "linear"
            read |= {"count": real_count} if real_count else {}
    elif kind == "ordinal" and all(is_number(value) for value in values):
        read["values"] = sorted(values)
    else:
        read["values"] = values
    if (prior := _prior(item)) is not None:
        read["prior"] = prior
    parameter = Parameter.from_dict(read)
    default = item.get("parameter_default", parameter.values[len(parameter.values) // 2])
    if kind == "real":
        default = nearest_value(name, parameter.values, default, notes)
    return replace(parameter, default=default)


def _prior(item: Mapping[str, Any]) -> object:
    """Return the prior of a parameter as a space's JSON has it, None where there is none."""
    prior, values = item.get("prior", "uniform"), item["values"]
    if prior == "custom_gaussian":
        mean, deviation = (
            item.get(f"custom_gaussian_prior_{field}") or [None] for field in ("means", "stds")
        )
        return {"mean": mean[0], "deviation": deviation[0]}
    if isinstance(prior, list) and len(prior) == len(values) and all(map(is_number, values)):
        return [weight for _, weight in sorted(zip(values, prior, strict=True))]  # ordinals are sorted, too
    return None if prior in ("uniform", "estimate") else prior


def _shared_normal(description: Mapping[str, Any], place: int, count: int) -> dict[str, Any]:
    """Return the part of a scenario's lists of means and deviations that is of parameter number `place`."""
    fields = ("custom_gaussian_prior_means", "custom_gaussian_prior_stds")
    lists = {field: description[field] for field in fields if field in description}
    for field, numbers in lists.items():
        if not isinstance(numbers, list) or len(numbers) not in (1, count):
            raise ScenarioError(f"{field} needs one number, or one for each parameter, not {numbers!r:.80}")
    return {field: [numbers[place % len(numbers)]] for field, numbers in lists.items()}


def nearest_value(name: str, values: Sequence[Value], default: object, notes: list[str]) -> Value:
    """Return the nearest of the `values` to a default, which may lie between two of them.

    Where it does, and these are listed, that is added to the `notes`. Raises ScenarioError for a default
    outside the values' range.
    """
    if not is_number(default):
        raise ScenarioError(f"input parameter {name!r}: default {default!r} is not a number")
    low, high = float(values[0]), float(values[-1])
    if not low <= float(default) <= high:  # type: ignore[arg-type]
        raise ScenarioError(f"input parameter {name!r}: default {default} is not in {low} .. {high}")
    if isinstance(values, Levels):
        return values[values.position(default)]  # type: ignore[arg-type]
    value = min(values, key=lambda value: abs(float(value) - float(default)))  # type: ignore[arg-type]
    if value != default:
        notes.append(f"{name}: its default {default} becomes the nearest value, {value:g}")
    return value


def _feasible(output: Mapping[str, Any]) -> tuple[str, str] | None:
    if not output:
        return None
    return str(output.get("name", "Valid")), str(output.get("true_value", "true"))


def _table(path: object) -> str | None:
    if path is not None and not isinstance(path, str):
        raise ScenarioError(f"exhaustive_search_file must be a text, not {path!r}")
    return path


def _section(description: Mapping[str, Any], field: str) -> Mapping[str, Any]:
    section = description.get(field) or {}
    if not isinstance(section, Mapping):
        raise ScenarioError(f"{field} must be an object, not {section!r}")
    return section


def _count(number: object, field: str) -> int | None:
    if number is None:
        return None
    if isinstance(number, bool) or not isinstance(number, int) or number < 0:
        raise ScenarioError(f"{field} must be a whole number, not {number!r}")
    return number
