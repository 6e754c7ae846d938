"""The systems that an exploration searches over: one, or each value of its space's parameter `system`."""

from collections.abc import Mapping
from typing import Any

from crowd.explorations.models import Exploration
from pareto import Space
from slam.definitions import without_optional
from slam.devices.build import split

SYSTEM = "system"  # the parameter that says which system runs a configuration
SEVERAL = "systems"  # the application of an exploration whose space has this parameter


def systems_of_space(space: Mapping[str, Any]) -> list[str]:
    """The values of the parameter SYSTEM in the description of a space, that of its default first."""
    for parameter in Space.from_dict(space).parameters:
        if parameter.name == SYSTEM:
            return sorted(map(str, parameter.values), key=lambda value: value != parameter.default)
    return []


def applications(exploration: Exploration) -> list[str]:
    """The applications that `exploration` can make fronts for, that of its default first."""
    if exploration.application != SEVERAL:
        return [exploration.application]
    return systems_of_space(exploration.space)


def application_of(exploration: Exploration, configuration: Mapping[str, Any]) -> str:
    """The system that runs `configuration`."""
    if exploration.application != SEVERAL:
        return exploration.application
    return str(configuration.get(SYSTEM))


def measured_parameters(exploration: Exploration, configuration: Mapping[str, Any]) -> dict[str, Any]:
    """What the system that runs `configuration` is given: all of it but the name of the system."""
    several = exploration.application == SEVERAL
    return {name: value for name, value in configuration.items() if not several or name != SYSTEM}


def published_parameters(exploration: Exploration, configuration: Mapping[str, Any]) -> dict[str, Any]:
    """The parameters of `configuration` that a front can have: without options of a build."""
    return split(measured_parameters(exploration, configuration))[0]


def default_of_system(space: Space, system: str) -> dict[str, Any]:
    """The configuration of `system` in which every active parameter has its default value."""
    defaults = {parameter.name: parameter.default for parameter in space.parameters}
    return without_optional(space.decode(space.index_of(defaults | {SYSTEM: system})))
