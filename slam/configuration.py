"""What the configurations of all systems share: reading, checking values, and the error."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any, ClassVar, Self


class ConfigurationError(ValueError):
    """An unknown parameter, or a value that the system cannot run."""


@dataclass(frozen=True)
class Parameters:
    """A system's parameters by name, as plain values: the base of its Configuration. `system`: its name."""

    system: ClassVar[str]

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any]) -> Self:
        """A configuration from names and values; absent names take their default.

        Raises ConfigurationError for an unknown name or an impossible value.
        """
        names = [field.name for field in fields(cls)]
        unknown = sorted(set(values) - set(names))
        if unknown:
            raise ConfigurationError(
                f"unknown parameter {', '.join(unknown)}: {cls.system} has {', '.join(names)}"
            )
        return cls(**values)

    def to_dict(self) -> dict[str, Any]:
        return asdict(self)


def whole(name: str, value: Any, least: int) -> int:
    """`value` as an int; 128.0 is accepted. Raises ConfigurationError for fractions and below `least`."""
    if isinstance(value, bool) or not isinstance(value, int | float) or value % 1 != 0:
        raise ConfigurationError(f"{name}={value!r}: must be a whole number")
    if value < least:
        raise ConfigurationError(f"{name}={value!r}: must be at least {least}")
    return int(value)


def finite(name: str, value: Any) -> float:
    """`value` as a float. Raises ConfigurationError for anything else, infinity and NaN."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ConfigurationError(f"{name}={value!r}: must be a finite number")
    return float(value)


def flag(name: str, value: Any) -> bool:
    """`value` as a bool, or 0 or 1 as on a command line. Raises ConfigurationError otherwise."""
    if not isinstance(value, int | float) or value not in (0, 1):
        raise ConfigurationError(f"{name}={value!r}: must be true or false (1 or 0)")
    return bool(value)
