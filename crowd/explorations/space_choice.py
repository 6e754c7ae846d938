"""The space of a new exploration: a shipped one, that of an earlier exploration, or a file."""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from django.core.exceptions import ValidationError

import pareto
from crowd.explorations.models import Exploration
from crowd.explorations.searching.applications import (
    SEVERAL,
    SYSTEM,
    default_of_system,
    systems_of_space,
)
from pareto import Space
from pareto.errors import ParetoError
from slam.configuration import ConfigurationError
from slam.definitions import SYSTEMS, without_optional
from slam.devices.build import split

SPACES = Path(pareto.__file__).parent / "spaces"
EARLIER = "exploration-"  # prefix of a choice for the space of an earlier exploration
LARGEST_FILE_BYTES = 256 << 10


def shipped_spaces() -> dict[Path, str]:
    """The files of the shipped spaces, each with the system that runs it."""
    return {path: system for path in sorted(SPACES.glob("*.json")) if (system := _system_of(path.stem))}


def space_choices() -> Iterator[tuple[str, str]]:
    """The choices of the form: each space once."""
    listed = set()
    for path, system in shipped_spaces().items():
        space = Space.load(path)
        listed.add(_identity(system, space.to_dict()))
        yield path.stem, f"{path.stem}: {describe_size(space)}"
    for key, application, description in Exploration.objects.order_by("-pk").values_list(
        "pk", "application", "space"
    ):
        identity = _identity(application, description)
        if identity not in listed:
            listed.add(identity)
            yield f"{EARLIER}{key}", f"as in exploration {key}"


def describe_size(space: Space) -> str:
    """The size of `space` in words."""
    return f"{len(space.parameters)} parameters, {len(space):,} configurations"


def space_of_choice(choice: str) -> tuple[str, dict[str, Any]]:
    """The system and space of `choice`."""
    if choice.startswith(EARLIER):
        earlier = Exploration.objects.get(pk=int(choice.removeprefix(EARLIER)))
        return earlier.application, earlier.space
    return _system_of(choice), Space.load(SPACES / f"{choice}.json").to_dict()


def choice_of(exploration: Exploration) -> str:
    """The choice for the space of `exploration`."""
    wanted = _identity(exploration.application, exploration.space)
    for path, system in shipped_spaces().items():
        if _identity(system, Space.load(path).to_dict()) == wanted:
            return path.stem
    same = Exploration.objects.filter(application=exploration.application, space=exploration.space)
    newest = same.order_by("-pk").first()
    return f"{EARLIER}{newest.pk if newest else exploration.pk}"


def read_space(content: bytes, name: str) -> Space:
    """Read the space in `content`, a file called `name`. Raises ValidationError."""
    if len(content) > LARGEST_FILE_BYTES:
        raise ValidationError(f"{name} has {len(content)} bytes: a space has {LARGEST_FILE_BYTES} at most")
    try:
        description = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise ValidationError(
            f"{name} is not JSON: {error}. See pareto/spaces/kfusion.json for an example"
        ) from error
    try:
        return Space.from_dict(description)
    except ParetoError as error:
        raise ValidationError(f"{name}: {error}") from error


def system_for(space: Space, wanted: str) -> str:
    """The system that runs `space` of a file: `wanted`, else that in the name of the space.

    SEVERAL if the space has the parameter SYSTEM. Raises ValidationError without either.
    """
    system = SEVERAL if SYSTEM in space.names else wanted or _system_of(space.name)
    if not system:
        names = " or ".join(SYSTEMS)
        raise ValidationError(f"the space {space.name!r} does not say which system runs it: choose {names}")
    return system


def check_fits(system: str, space: Mapping[str, Any]) -> None:
    """Raise ValidationError if `system`, or one of several, cannot run its default of `space`."""
    read = Space.from_dict(space)
    defaults = {system: without_optional(read.default)}
    if system == SEVERAL:
        defaults = {one: default_of_system(read, one) for one in systems_of_space(space)}
        if unknown := sorted(defaults.keys() - SYSTEMS.keys()):
            raise ValidationError(f"{SYSTEM} is {unknown[0]!r}: its values can be {' and '.join(SYSTEMS)}")
    for one, default in defaults.items():
        if one not in SYSTEMS:
            continue  # an unknown system cannot be checked
        try:
            parameters, _ = split({name: default[name] for name in default if name != SYSTEM})
            SYSTEMS[one].complete(parameters)
        except ConfigurationError as error:
            raise ValidationError(f"{one} cannot run the space {space.get('name')!r}: {error}") from error


def _system_of(name: str) -> str:
    """The system at the start of a space's `name`, such as elasticfusion-loops; empty without one."""
    return next((one for one in (*SYSTEMS, SEVERAL) if name == one or name.startswith(f"{one}-")), "")


def _identity(application: str, space: Mapping[str, Any]) -> str:
    return json.dumps([application, space], sort_keys=True)
