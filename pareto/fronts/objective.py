"""Objectives: names, directions, and the limits that a result must keep."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from pareto.errors import ObjectiveError
from pareto.fronts.censored import Censored
from pareto.numbers import is_finite

TELL_NONE = "tell None for a failed evaluation"


@dataclass(frozen=True)
class Objective:
    """A named number to minimise, or to maximise."""

    name: str
    maximise: bool = False

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise ObjectiveError(f"an objective needs a name, not {self.name!r}")

    @property
    def sign(self) -> int:
        """1 when lower is better, -1 when higher is: value * sign is minimised."""
        return -1 if self.maximise else 1


def read_objectives(objectives: Iterable[str | Objective]) -> tuple[Objective, ...]:
    """Return objectives; a bare name is minimised. Raises ObjectiveError on none or a duplicate."""
    if isinstance(objectives, str):
        raise ObjectiveError(f'objectives must be a list of names: ("{objectives}",)')
    if not isinstance(objectives, Iterable):
        raise ObjectiveError(f"objectives must be a list of names, not {objectives!r}")
    read = tuple(item if isinstance(item, Objective) else Objective(item) for item in objectives)
    names = [objective.name for objective in read]
    if not read or len(set(names)) != len(names):
        raise ObjectiveError(f"objectives must be one or more different names, not {names}")
    return read


def read_limits(objectives: tuple[Objective, ...], limits: Mapping[str, float] | None) -> dict[str, float]:
    """Return `limits` as floats. Raises ObjectiveError for an unknown objective or a limit not a number."""
    names = [objective.name for objective in objectives]
    if limits is not None and not isinstance(limits, Mapping):
        raise ObjectiveError(f"limits must map objectives to numbers, not {limits!r}")
    read = {}
    for name, limit in (limits or {}).items():
        if name not in names:
            raise ObjectiveError(f"limit on {name!r}, which is not an objective: they are {', '.join(names)}")
        read[name] = read_number(name, limit, "leave the limit out where there is none")
    return read


def read_values(
    objectives: tuple[Objective, ...], values: Mapping[str, float], remedy: str = TELL_NONE
) -> tuple[float, ...]:
    """Return the objectives' values in order. Further keys in `values` are ignored.

    A Censored value stays one.

    Raises ObjectiveError for a missing objective, or, with the `remedy`, a value that is not a finite number.
    """
    if not isinstance(values, Mapping):
        raise ObjectiveError(
            f"values must map objectives to numbers (or be None for a failure), not {values!r}"
        )
    read = []
    for objective in objectives:
        if objective.name not in values:
            raise ObjectiveError(f"objective {objective.name!r} is missing from {dict(values)}")
        read.append(read_value(objective.name, values[objective.name], remedy))
    return tuple(read)


def read_value(name: str, value: object, remedy: str = TELL_NONE) -> float:
    """Return a measured `value` as a float or as Censored. Raises ObjectiveError as `read_number` does."""
    number = read_number(name, value, remedy)
    return Censored(number) if isinstance(value, Censored) else number


def read_number(name: str, value: object, remedy: str = TELL_NONE) -> float:
    """Return `value` as a float. Raises ObjectiveError, with the `remedy`, unless it is a finite number."""
    if hasattr(value, "item") and getattr(value, "size", 1) == 1:  # NumPy scalars
        value = value.item()
    if isinstance(value, int) and not is_finite(value):
        raise ObjectiveError(f"{name} is too large a number: about 1.8e308 is the largest that is kept")
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise ObjectiveError(f"{name} = {value!r} is not a finite number: {remedy}")
    return float(value)
