"""Which values count as numbers."""

from __future__ import annotations

import math


def is_number(value: object) -> bool:
    """Return whether `value` is a number; true and false are not."""
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def is_finite(number: float) -> bool:
    """Return whether `number` is finite as a float; whole numbers beyond 1.8e308 are not."""
    try:
        return math.isfinite(number)
    except OverflowError:
        return False


def as_printed(number: float) -> float | int:
    """Return a count as a whole number, as programs print it: 3 for 3.0; any other number as a float."""
    return int(number) if number.is_integer() and abs(number) < 2**53 else float(number)
