"""HyperMapper's scenario files, written from a space; `scenario` reads them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from pareto.errors import ScenarioError
from pareto.fronts.objective import Objective
from pareto.spaces.parameter import Parameter, Value
from pareto.spaces.space import Space
from pareto.spaces.user_prior import Normal, written_user_prior


def write_hypermapper(space: Space, objectives: Sequence[Objective]) -> tuple[dict[str, Any], list[str]]:
    """Return a scenario of HyperMapper 2, and sentences on what it cannot express.

    Numbers keep the values that they have here: reals with listed values become ordinals. Raises
    ScenarioError where objectives are missing, or a name is one that HyperMapper refuses.
    """
    if not objectives:
        raise ScenarioError("--objectives is missing: a HyperMapper scenario names them")
    for name in space.names:
        if not re.fullmatch(r"[0-9A-Za-z_-]+", name):
            raise ScenarioError(f"HyperMapper refuses the name {name!r}: use letters, digits, _ and -")
    notes = []
    if space.constraints:
        texts = ", ".join(repr(constraint.text) for constraint in space.constraints)
        notes.append(f"HyperMapper has no constraints: {texts} left out; let your program fail there")
    if space.conditions:
        names = ", ".join(space.conditions.names)
        notes.append(f"HyperMapper has no conditions: {names} are always active there")
    if upwards := [objective.name for objective in objectives if objective.maximise]:
        notes.append(f"HyperMapper minimises: let your program negate {', '.join(upwards)}")
    if ordered := [item.name for item in space.parameters if item.type == "ordinal" and _has_texts(item)]:
        notes.append(f"HyperMapper orders numbers only: {', '.join(ordered)} became categorical")
    described = {
        "application_name": space.name,
        "optimization_objectives": [objective.name for objective in objectives],
        "input_parameters": {item.name: _written(item) for item in space.parameters},
    }
    return described, notes


def _written(item: Parameter) -> dict[str, Any]:
    written = _written_values(item)
    if isinstance(item.prior, Normal):
        written["prior"] = "custom_gaussian"
        written["custom_gaussian_prior_means"] = [item.prior.mean]
        written["custom_gaussian_prior_stds"] = [item.prior.deviation]
    elif item.prior is not None:
        written["prior"] = written_user_prior(item.prior)
    return written


def _written_values(item: Parameter) -> dict[str, Any]:
    written: dict[str, Any]
    if item.levels:
        written = {"parameter_type": "real", "values": [item.levels.minimum, item.levels.maximum]}
        if item.levels.scale == "log":
            written["transform"] = "log"
        return {**written, "parameter_default": item.default}
    values = list(item.values)
    if item.type in ("categorical", "boolean") or _has_texts(item):
        written = {"parameter_type": "categorical", "values": [_text(value) for value in values]}
        return {**written, "parameter_default": _text(item.default)}
    if item.contiguous:
        written = {"parameter_type": "integer", "values": [values[0], values[-1]]}
    else:
        written = {"parameter_type": "ordinal", "values": values}
    return {**written, "parameter_default": item.default}


def _has_texts(item: Parameter) -> bool:
    return not item.levels and any(isinstance(value, (str, bool)) for value in item.values)


def _text(value: Value) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)
