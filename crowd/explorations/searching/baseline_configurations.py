"""The configurations of an application that are known before any search."""

from typing import Any

from crowd.explorations.searching.applications import SEVERAL, SYSTEM, default_of_system, systems_of_space
from pareto import Space
from slam.definitions import SYSTEMS, without_optional

DEFAULT = "default"
DEFAULT_OF_THE_APP = "STANDARD"


def baseline_configurations(application: str, space: Space) -> dict[str, dict[str, Any]]:
    """The known configurations by label. All speedups are relative to `default`.

    For kfusion, those of the published Android app; for others, the default of `space`. Of several systems,
    the labels of all but the first begin with the system's name.
    """
    if application == SEVERAL:
        first, *others = systems_of_space(space.to_dict())
        return _of_system(first, space) | {
            f"{system}-{label}": configuration
            for system in others
            for label, configuration in _of_system(system, space).items()
        }
    return _published(application) or {DEFAULT: without_optional(space.default)}


def is_default(label: str) -> bool:
    """Whether `label` is that of the default of any system."""
    return label == DEFAULT or label.endswith(f"-{DEFAULT}")


def _of_system(system: str, space: Space) -> dict[str, dict[str, Any]]:
    known = _published(system) or {DEFAULT: default_of_system(space, system)}
    return {label: {SYSTEM: system} | configuration for label, configuration in known.items()}


def _published(application: str) -> dict[str, dict[str, Any]]:
    known = SYSTEMS[application].known if application in SYSTEMS else {}
    return {
        DEFAULT if name == DEFAULT_OF_THE_APP else name.lower(): dict(configuration)
        for name, configuration in known.items()
    }
