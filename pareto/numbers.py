"""What counts as a number."""

from __future__ import annotations

import math


def is_number(value: object) -> bool:
    """Return whether `value` is a number: true and false are none."""
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def is_finite(number: float) -> bool:
    """Return whether a float holds `number`: not so NaN, infinity and whole numbers beyond 1.8e308."""
    try:
        return math.isfinite(number)
    except OverflowError:
        return False
