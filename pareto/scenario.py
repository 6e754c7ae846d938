"""HyperMapper scenario files, read into a space, objectives and budgets of our own."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pareto.errors import ScenarioError
from pareto.objective import Objective, read_objectives
from pareto.parameter import Parameter
from pareto.space import Space


@dataclass(frozen=True)
class Scenario:
    """What a scenario file asks for.

    `feasible` is the column that tells whether an evaluation counts and the text it then holds;
    `initial` and `iterations` are the evaluations before and after learning begins, None where not given.
    """

    space: Space
    objectives: tuple[Objective, ...]
    feasible: tuple[str, str] | None = None
    initial: int | None = None
    iterations: int | None = None

    @classmethod
    def load(cls, path: str | Path, real_count: int = 33) -> Scenario:
        """Read a HyperMapper JSON file; see `from_dict`."""
        try:
            description = json.loads(Path(path).read_text(encoding="utf-8"))
        except OSError as error:
            raise ScenarioError(f"cannot read the scenario {path}: {error.strerror}") from error
        except ValueError as error:
            raise ScenarioError(f"{path} is not JSON: {error}") from error
        return cls.from_dict(description, real_count=real_count)

    @classmethod
    def from_dict(cls, description: Mapping[str, Any], real_count: int = 33) -> Scenario:
        """Read `application_name`, `input_parameters`, `optimization_objectives`, `feasible_output`, counts.

        Real parameters become `real_count` evenly spaced values. Priors, models and output files are other
        programs' concern and ignored. A parameter without a default takes its middle value, as HyperMapper's
        users leave it out when they have no better guess.

        Raises ScenarioError when parameters or objectives are missing or of an unknown type, SpaceError when
        a parameter's values are not well formed.
        """
        if not is_scenario(description):
            raise ScenarioError("a scenario has input_parameters and optimization_objectives")
        inputs = description["input_parameters"]
        if not isinstance(inputs, Mapping) or not inputs:
            raise ScenarioError("input_parameters must map names to parameters")
        parameters = [_parameter(name, item, real_count) for name, item in inputs.items()]
        space = Space(parameters, name=str(description.get("application_name") or "scenario"))
        design = description.get("design_of_experiment") or {}
        return cls(
            space=space,
            objectives=read_objectives(description["optimization_objectives"]),
            feasible=_feasible(description.get("feasible_output")),
            initial=_count(design.get("number_of_samples"), "number_of_samples"),
            iterations=_count(description.get("optimization_iterations"), "optimization_iterations"),
        )


def is_scenario(description: object) -> bool:
    """Return whether a JSON document is a HyperMapper scenario rather than a space."""
    return isinstance(description, Mapping) and {"input_parameters", "optimization_objectives"} <= set(
        description
    )


def _parameter(name: str, item: Mapping[str, Any], real_count: int) -> Parameter:
    kind, values = item.get("parameter_type"), item.get("values")
    if not isinstance(values, list) or not values:
        raise ScenarioError(f"input parameter {name!r} needs a list of values, not {values!r}")
    read: dict[str, Any] = {"name": name, "type": kind}
    if kind in ("integer", "real"):
        if len(values) != 2:
            raise ScenarioError(f"input parameter {name!r}: values must be [minimum, maximum], not {values}")
        read |= {"minimum": values[0], "maximum": values[1]} | (
            {"count": real_count} if kind == "real" else {}
        )
    elif kind == "ordinal":
        read["values"] = sorted(values)
    elif kind == "categorical":
        read["values"] = values
    else:
        raise ScenarioError(
            f"input parameter {name!r}: type {kind!r} is not real, integer, ordinal or categorical"
        )
    parameter = Parameter.from_dict(read)
    default = item.get("parameter_default", parameter.values[len(parameter.values) // 2])
    if kind == "real":
        # The default of a real rarely lies on our grid: the nearest value stands for it.
        default = min(parameter.values, key=lambda value: abs(float(value) - float(default)))
    return Parameter(name, parameter.type, parameter.values, default)


def _feasible(output: Mapping[str, Any] | None) -> tuple[str, str] | None:
    if not output:
        return None
    if "name" not in output:
        raise ScenarioError(
            "feasible_output needs a name: the column that tells whether an evaluation counts"
        )
    return str(output["name"]), str(output.get("true_value", "true"))


def _count(number: object, field: str) -> int | None:
    if number is None:
        return None
    if isinstance(number, bool) or not isinstance(number, int) or number < 0:
        raise ScenarioError(f"{field} must be a whole number, not {number!r}")
    return number
