"""The SLAM systems that exist, by name, without any device. `slam.registry` makes them run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from slam.configuration import ConfigurationError
from slam.elasticfusion.definition import ELASTICFUSION
from slam.kfusion.definition import KFUSION
from slam.system import Definition

SYSTEMS: Mapping[str, Definition] = {"kfusion": KFUSION, "elasticfusion": ELASTICFUSION}


def definition(name: str) -> Definition:
    """The definition of the system `name`. Raises ValueError, which lists the known ones."""
    if name not in SYSTEMS:
        raise ValueError(f"unknown system {name!r}: choose one of {', '.join(sorted(SYSTEMS))}")
    return SYSTEMS[name]


def complete(name: str, configuration: Mapping[str, Any]) -> dict[str, Any]:
    """All parameters of the system `name`, with defaults for those that `configuration` leaves out.

    Raises ValueError for an unknown name, ConfigurationError for a bad parameter.
    """
    return definition(name).complete(configuration)


OPTIONAL = frozenset(name for system in SYSTEMS.values() for name in system.optional)


def without_optional(configuration: Mapping[str, Any]) -> dict[str, Any]:
    """`configuration` without parameters that change nothing.

    Those are inactive ones (None), and those that a system leaves out where they are 0. So a configuration
    from before such a parameter existed equals one that does not use it.
    """
    return {
        name: value
        for name, value in configuration.items()
        if value is not None and (value or name not in OPTIONAL)
    }


def require_backend(name: str, backend: str) -> None:
    """Raise ConfigurationError where the system `name` does not run on `backend`, ValueError for an unknown
    name.
    """
    backends = definition(name).backends
    if backend not in backends:
        raise ConfigurationError(f"backend {backend}: {name} runs on {' and '.join(backends)} only")
