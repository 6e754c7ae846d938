"""The values of a number between a minimum and a maximum: by a step, by a count on a scale, or any."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from typing import Any, overload

from pareto.errors import SpaceError
from pareto.numbers import is_finite, is_number

MOST_VALUES = 2**20  # of one parameter: they are kept in a list
FINEST, COARSEST = 16, 6  # levels of a number that may take any value, as powers of two


@dataclass(frozen=True)
class Levels(Sequence[float]):
    """Any value from `minimum` to `maximum`, as `size` levels that are evenly spaced on a `scale`.

    They are computed when needed, and rounded to as many digits as tell neighbours apart.
    """

    minimum: float
    maximum: float
    scale: str = "linear"
    size: int = 2**FINEST

    def __len__(self) -> int:
        return self.size

    @overload
    def __getitem__(self, position: int) -> float: ...
    @overload
    def __getitem__(self, position: slice) -> list[float]: ...
    def __getitem__(self, position: int | slice) -> float | list[float]:
        if isinstance(position, slice):
            return [self._level(number) for number in range(self.size)[position]]
        return self._level(range(self.size)[position])

    def position(self, value: float) -> int:
        """Return the position of the level nearest to a value within the range."""
        low, high, value = map(self._scaled, (self.minimum, self.maximum, value))
        return round((value - low) / (high - low) * (self.size - 1))

    def _level(self, number: int) -> float:
        if number == self.size - 1:
            return float(self.maximum)
        share = number / (self.size - 1)
        if self.scale == "log":
            step = math.log(self.maximum / self.minimum) / self.size
            value = self.minimum * (self.maximum / self.minimum) ** share
        else:
            largest = max(abs(self.minimum), abs(self.maximum))
            step = (self.maximum - self.minimum) / self.size / largest
            value = self.minimum + (self.maximum - self.minimum) * share
        return float(f"{value:.{2 - math.floor(math.log10(step))}g}") if number else float(self.minimum)

    def _scaled(self, value: float) -> float:
        return math.log(value) if self.scale == "log" else value


def spaced(description: Mapping[str, Any]) -> list[int] | list[float] | Levels:
    """Return the values from `minimum` to `maximum` that `step`, or `count` and `scale`, ask for.

    A real without a step and a count takes any value. `description` is a parameter's. Raises SpaceError for a
    range, a step or a count that is not possible.
    """
    name, whole = description.get("name"), description.get("type") == "integer"
    any_value = not whole and not {"count", "step"} & description.keys()
    by_count = "count" in description or any_value
    if by_count and "step" in description:
        raise SpaceError(f"parameter {name!r}: give a step or a count, not both")
    if not by_count and "scale" in description:
        raise SpaceError(f"parameter {name!r}: a scale needs a count of values")
    low, high = _number(description, "minimum"), _number(description, "maximum")
    if high < low or (whole and (low != int(low) or high != int(high))):
        raise SpaceError(
            f"parameter {name!r}: no {'whole ' if whole else ''}numbers from {low} to {high}: "
            "minimum < maximum is needed"
        )
    if any_value:
        _require_scale(description, low, high)
        return Levels(low, high, description.get("scale", "linear"))
    if by_count:
        values = _by_count(description, low, high)
        return sorted({round(value) for value in values}) if whole else values
    step = _number(description, "step") if "step" in description else 1
    if step <= 0 or (whole and step != int(step)):
        raise SpaceError(f"parameter {name!r}: a step of {step} from {low} to {high} is not possible")
    if whole:
        _require_few(name, (int(high) - int(low)) // int(step) + 1)
        return list(range(int(low), int(high) + 1, int(step)))
    _require_few(name, (high - low) / step + 1)
    # In decimals, as they are written: three steps of 0.1 are 0.3, and the maximum is not missed by rounding.
    start, stop, stride = (Decimal(repr(number)) for number in (low, high, step))
    return [float(start + number * stride) for number in range(int((stop - start) // stride) + 1)]


def _by_count(description: Mapping[str, Any], low: float, high: float) -> list[float]:
    name, count = description.get("name"), _number(description, "count")
    if count < 2 or count != int(count):
        raise SpaceError(f"parameter {name!r}: needs a whole count of 2 or more, not {count}")
    _require_scale(description, low, high)
    _require_few(name, count)
    steps = int(count) - 1
    if description.get("scale") == "log":
        values = [low * (high / low) ** (step / steps) for step in range(steps + 1)]
    else:
        values = [low + (high - low) * step / steps for step in range(steps + 1)]
    return [*values[:-1], float(high)]


def _require_scale(description: Mapping[str, Any], low: float, high: float) -> None:
    name, scale = description.get("name"), description.get("scale", "linear")
    if high <= low:
        raise SpaceError(f"parameter {name!r}: needs minimum < maximum, not {low} and {high}")
    if scale not in ("linear", "log") or (scale == "log" and low <= 0):
        raise SpaceError(
            f"parameter {name!r}: scale must be linear, or log with a minimum above 0; not {scale!r}"
        )


def _number(description: Mapping[str, Any], field: str) -> float:
    number = description.get(field)
    if not is_number(number) or not is_finite(number):  # type: ignore[arg-type]
        raise SpaceError(
            f"parameter {description.get('name')!r}: give values, or a finite {field} ({number!r:.40})"
        )
    return number  # type: ignore[return-value]


def _require_few(name: object, count: float) -> None:
    # Before the list is made: a range of 10^12 whole numbers must not fill the memory.
    if count > MOST_VALUES:
        raise SpaceError(
            f"parameter {name!r} would have {count:,} values: at most {MOST_VALUES:,}, use a larger step"
        )
