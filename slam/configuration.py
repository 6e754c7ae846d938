"""What the configurations of all systems have in common: how values are checked, and the error they raise."""

from __future__ import annotations

import math
from typing import Any


class ConfigurationError(ValueError):
    """A parameter that a system does not have, or a value that it cannot run."""


def whole(name: str, value: Any, least: int) -> int:
    """`value` as an int; 128.0 will do. Raises ConfigurationError for fractions and below `least`."""
    if isinstance(value, bool) or not isinstance(value, int | float) or value % 1 != 0:
        raise ConfigurationError(f"{name}={value!r}: must be a whole number")
    if value < least:
        raise ConfigurationError(f"{name}={value!r}: must be at least {least}")
    return int(value)


def finite(name: str, value: Any) -> float:
    """`value` as a float. Raises ConfigurationError for what is no number, infinite or NaN."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ConfigurationError(f"{name}={value!r}: must be a finite number")
    return float(value)


def flag(name: str, value: Any) -> bool:
    """`value` as a bool; 0 and 1 will do, as command lines write them, else ConfigurationError."""
    if not isinstance(value, int | float) or value not in (0, 1):
        raise ConfigurationError(f"{name}={value!r}: must be true or false (1 or 0)")
    return bool(value)
