"""What is known of a SLAM system without any device: every start of a server, and every client, reads it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from slam.devices.layout import Layout
    from slam.plans.plan import Plan
    from slam.system import Scene


@dataclass(frozen=True)
class Parameter:
    """A parameter of the design space: its `values`, ascending (0 and 1 for a flag), meaning and unit."""

    values: tuple[float, ...]
    meaning: str
    unit: str = ""

    def __str__(self) -> str:
        return f"{self.meaning} ({self.unit})" if self.unit else self.meaning


@dataclass(frozen=True)
class Definition:
    """A system.

    `title`: its name in papers. `complete`: all parameters of a configuration, with defaults; raises
    ConfigurationError for a bad one. `backends`: those it runs on. `colour`: whether it needs colour images
    beside depth. `size_multiple`: what the sides of its images must be multiples of, in pixels, for a
    complete configuration. `warm_up`: for a complete configuration, one that launches all of its kernels
    within a few frames. `parameters`: those of its design space. `stages`: what happens in each.
    `unattempted`: why some frames are not tracked. `plan`: a frame as data, None for a system that the host
    drives. `known`: configurations of others, by label. `packages`: those it needs beyond the base
    installation, with the module of each.
    """

    title: str
    complete: Callable[[Mapping[str, Any]], dict[str, Any]]
    backends: tuple[str, ...]
    colour: bool
    size_multiple: Callable[[Mapping[str, Any]], int]
    warm_up: Callable[[Mapping[str, Any]], dict[str, Any]]
    parameters: Mapping[str, Parameter]
    stages: Mapping[str, str]
    unattempted: str
    plan: Callable[[Mapping[str, Any], Scene, Layout], Plan] | None = None
    known: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    packages: Mapping[str, str] = field(default_factory=dict)
