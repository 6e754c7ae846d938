"""One parameter of a space: a name and the finite, ordered list of values it may take."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from pareto.errors import ConfigurationError, SpaceError

TYPES = ("ordinal", "categorical", "boolean", "integer", "real")
Value = bool | int | float | str


@dataclass(frozen=True)
class Parameter:
    """A named choice between finitely many values.

    `type` is one of TYPES. Only `categorical` values have no order; the values of all other types are
    kept in the order given, which must be ascending for numbers.
    """

    name: str
    type: str
    values: tuple[Value, ...]
    default: Value

    def __post_init__(self) -> None:
        if not self.name or not isinstance(self.name, str):
            raise SpaceError(f"a parameter needs a name, not {self.name!r}")
        if self.type not in TYPES:
            raise SpaceError(f"parameter {self.name!r}: type {self.type!r} is not one of {', '.join(TYPES)}")
        if not self.values:
            raise SpaceError(f"parameter {self.name!r} has no values: give at least one")
        if self.type != "categorical":
            self._require_order()
        if len(self._codes) != len(self.values):
            raise SpaceError(f"parameter {self.name!r}: values {list(self.values)} contain a duplicate")
        try:
            self.encode(self.default)
        except ConfigurationError as error:
            raise SpaceError(f"default of {error}") from None

    @property
    def ordered(self) -> bool:
        """Whether neighbouring values are similar, so that models may interpolate between them."""
        return self.type != "categorical"

    @cached_property
    def _codes(self) -> dict[tuple[str, Value], int]:
        return {_key(value): code for code, value in enumerate(self.values)}

    def encode(self, value: object) -> int:
        """Return the position of `value`; numbers match to 1e-9, relative.

        Raises ConfigurationError when the parameter cannot take the value.
        """
        value = value.item() if hasattr(value, "item") else value  # NumPy scalars
        if self.type == "boolean" and isinstance(value, int) and value in (0, 1):
            value = bool(value)
        if isinstance(value, (bool, int, float, str)):
            code = self._codes.get(_key(value))
            if code is not None:
                return code
            if isinstance(value, float):
                for code, mine in enumerate(self.values):
                    if not isinstance(mine, (str, bool)) and math.isclose(mine, value, rel_tol=1e-9):
                        return code
        raise ConfigurationError(f"parameter {self.name!r}: {value!r} is not one of {self._some_values()}")

    def parse(self, text: str) -> Value:
        """Return the value that `text` (a CSV cell, a command line) stands for.

        Raises ConfigurationError when no value is written like that.
        """
        text = text.strip()
        for value in self.values:
            if str(value) == text or (isinstance(value, bool) and str(value).lower() == text.lower()):
                return value
        try:
            number = float(text)
        except ValueError:
            return self.values[self.encode(text)]
        return self.values[self.encode(int(number) if number.is_integer() else number)]

    def to_dict(self) -> dict[str, Any]:
        """Return the plain-JSON description that `from_dict` reads."""
        return {"name": self.name, "type": self.type, "values": list(self.values), "default": self.default}

    @classmethod
    def from_dict(cls, description: Mapping[str, Any]) -> Parameter:
        """Read one parameter; the default value is the first one where none is given.

        Booleans need no values, integers take `minimum`, `maximum` and `step` (1) instead of values, and
        reals `minimum`, `maximum`, `count` and `scale` ("linear" or "log").
        """
        name, kind = description.get("name", ""), description.get("type", "")
        known = {"name", "type", "values", "default", "minimum", "maximum", "step", "count", "scale"}
        if unknown := set(description) - known:
            raise SpaceError(
                f"parameter {name!r}: unknown field {sorted(unknown)[0]!r}; known are {sorted(known)}"
            )
        values = description.get("values")
        if values is None and kind == "boolean":
            values = (False, True)
        elif values is None and kind == "integer":
            values = _integers(description)
        elif values is None and kind == "real":
            values = _reals(description)
        elif not isinstance(values, (list, tuple)):
            raise SpaceError(f"parameter {name!r}: values must be a list, not {values!r}")
        values = tuple(values)
        if bad := [value for value in values if not isinstance(value, (bool, int, float, str))]:
            raise SpaceError(f"parameter {name!r}: {bad[0]!r} is neither a number, a text nor true or false")
        default = description.get("default", values[0] if values else None)
        return cls(name=name, type=kind, values=values, default=default)

    def _require_order(self) -> None:
        if self.type == "boolean" and set(self.values) - {False, True}:
            raise SpaceError(f"parameter {self.name!r}: a boolean is true or false, not {list(self.values)}")
        numbers = [value for value in self.values if isinstance(value, (int, float))]
        if self.type in ("integer", "real") and len(numbers) != len(self.values):
            raise SpaceError(
                f"parameter {self.name!r}: {self.type} values must be numbers: {self._some_values()}"
            )
        if any(not math.isfinite(number) for number in numbers):
            raise SpaceError(f"parameter {self.name!r}: values must be finite, not {self._some_values()}")
        if len(numbers) == len(self.values) and list(numbers) != sorted(numbers):
            raise SpaceError(f"parameter {self.name!r}: give the numbers in ascending order")

    def _some_values(self) -> str:
        if len(self.values) <= 12:
            return str(list(self.values))
        return f"{list(self.values[:5])} ... {self.values[-1]!r} ({len(self.values)} values)"


def _key(value: Value) -> tuple[str, Value]:
    # 1 and True are equal in Python, yet "1 thread" and "yes" are different values.
    kind = "boolean" if isinstance(value, bool) else "text" if isinstance(value, str) else "number"
    return kind, value


def _bound(description: Mapping[str, Any], field: str) -> float:
    number = description.get(field)
    if isinstance(number, bool) or not isinstance(number, (int, float)) or not math.isfinite(number):
        raise SpaceError(
            f"parameter {description.get('name')!r}: give values, or a finite {field} ({number!r})"
        )
    return number


def _integers(description: Mapping[str, Any]) -> range:
    low, high, step = (_bound({"step": 1, **description}, field) for field in ("minimum", "maximum", "step"))
    if step < 1 or high < low or any(number != int(number) for number in (low, high, step)):
        raise SpaceError(
            f"parameter {description.get('name')!r}: no whole numbers from {low} to {high} by {step}"
        )
    return range(int(low), int(high) + 1, int(step))


def _reals(description: Mapping[str, Any]) -> list[float]:
    low, high, count = (_bound(description, field) for field in ("minimum", "maximum", "count"))
    scale = description.get("scale", "linear")
    name = description.get("name")
    if count < 2 or count != int(count) or high <= low:
        raise SpaceError(f"parameter {name!r}: a real needs minimum < maximum and a whole count of 2 or more")
    if scale not in ("linear", "log") or (scale == "log" and low <= 0):
        raise SpaceError(
            f"parameter {name!r}: scale must be linear, or log with a minimum above 0; not {scale!r}"
        )
    steps = int(count) - 1
    if scale == "log":
        values = [low * (high / low) ** (step / steps) for step in range(steps + 1)]
    else:
        values = [low + (high - low) * step / steps for step in range(steps + 1)]
    return [*values[:-1], float(high)]
