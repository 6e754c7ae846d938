"""The SLAM systems that exist, by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from slam.kfusion import tuning
from slam.kfusion.configuration import Configuration
from slam.kfusion.pipeline import KFusion
from slam.layout import Layout
from slam.opencl import Device, Session
from slam.system import Scene, System


@dataclass(frozen=True)
class Definition:
    """How a system is made: its whole configuration, the layout of its kernels, the system itself."""

    complete: Callable[[Mapping[str, Any]], dict[str, Any]]
    layout_for: Callable[[Device], Layout]
    create: Callable[[Mapping[str, Any], Scene, Session], System]


SYSTEMS = {
    "kfusion": Definition(
        complete=lambda values: Configuration.from_mapping(values).to_dict(),
        layout_for=tuning.layout_for,
        create=lambda values, scene, session: KFusion(Configuration.from_mapping(values), scene, session),
    )
}


def complete(name: str, configuration: Mapping[str, Any]) -> dict[str, Any]:
    """All parameters of the system `name`, with defaults for those that `configuration` leaves out.

    Needs no device. Raises ValueError for an unknown name, ConfigurationError for a bad parameter.
    """
    return _definition(name).complete(configuration)


def open_session(name: str, device: Device) -> Session:
    """A session on `device`, with kernels laid out as is fastest there for the system `name`.

    Raises ValueError for an unknown name.
    """
    return Session(device, _definition(name).layout_for(device))


def create(name: str, configuration: Mapping[str, Any], scene: Scene, session: Session) -> System:
    """The system `name`, ready for its first frame. Raises ValueError for an unknown name."""
    return _definition(name).create(configuration, scene, session)


def _definition(name: str) -> Definition:
    if name not in SYSTEMS:
        raise ValueError(f"unknown system {name!r}: choose one of {', '.join(sorted(SYSTEMS))}")
    return SYSTEMS[name]
