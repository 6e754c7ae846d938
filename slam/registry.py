"""The programs of the SLAM systems, by name: what `slam.definitions` defines runs here."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from slam.configuration import ConfigurationError
from slam.datasets import Sequence
from slam.datasets.cropped import cropped
from slam.definitions import complete, definition, require_backend
from slam.devices import choice
from slam.devices.build import DEFAULT, Build
from slam.devices.choice import AnySession
from slam.devices.device import Device
from slam.devices.layout import Layout
from slam.devices.opencl import SHARED, Session
from slam.devices.tuning import SCENE, Progress, Trial, layout_for
from slam.elasticfusion.configuration import Configuration as ElasticConfiguration
from slam.elasticfusion.pipeline import ElasticFusion
from slam.kfusion.configuration import Configuration as KFusionConfiguration
from slam.kfusion.definition import TRIED
from slam.kfusion.pipeline import KFusion
from slam.plans.plan import Plan
from slam.system import Scene, System


@dataclass(frozen=True)
class Program:
    """A system that runs: its constructor, and a trial of its layouts."""

    create: Callable[[Mapping[str, Any], Scene, Any], System]
    trial: Trial


def _kfusion(values: Mapping[str, Any], scene: Scene, session: AnySession) -> System:
    return KFusion(KFusionConfiguration.from_mapping(values), scene, session)


def _elasticfusion(values: Mapping[str, Any], scene: Scene, session: Session) -> System:
    return ElasticFusion(ElasticConfiguration.from_mapping(values), scene, session)


FOLDER = Path(__file__).parent
ELASTIC_TRIED = ElasticConfiguration(open_loop=True, surfel_capacity=200_000)

PROGRAMS = {
    "kfusion": Program(
        _kfusion,
        Trial(lambda session: KFusion(TRIED, SCENE, session), (FOLDER / "kfusion" / "kernels", SHARED)),
    ),
    "elasticfusion": Program(
        _elasticfusion,
        Trial(
            lambda session: ElasticFusion(ELASTIC_TRIED, SCENE, session),
            (FOLDER / "elasticfusion" / "kernels", SHARED),
        ),
    ),
}


def fit(name: str, configuration: Mapping[str, Any], sequence: Sequence) -> Sequence:
    """`sequence`, cropped as the system `name` with `configuration` needs; a pack is never cropped.

    Raises ValueError for an unknown name, ConfigurationError for a bad parameter.
    """
    return cropped(sequence, definition(name).size_multiple(complete(name, configuration)))


def frame_plan(name: str, configuration: Mapping[str, Any], scene: Scene, layout: Layout) -> Plan:
    """The steps of the system `name` in each frame, as data.

    Raises ValueError for an unknown name, ConfigurationError for a system without a plan and for a bad
    parameter.
    """
    make = definition(name).plan
    if make is None:
        raise ConfigurationError(f"system {name}: the host drives it, so it has no plan; kfusion has one")
    plan: Plan = make(configuration, scene, layout)
    return plan


def open_session(
    name: str, device: Device, progress: Progress | None = None, build: Build = DEFAULT
) -> AnySession:
    """A session on `device`, with the fastest kernel layout there for the system `name`, or that of `build`.

    While layouts are tried, `progress` is called with the numbers done and in total. Raises ValueError for an
    unknown name, ConfigurationError where the system does not run on the device's backend, or the device
    cannot do `build`.
    """
    require_backend(name, device.backend)
    if device.backend != "opencl":
        return choice.open_session(device, build=build)
    return choice.open_session(device, layout_for(device, PROGRAMS[name].trial, progress, build), build=build)


def create(name: str, configuration: Mapping[str, Any], scene: Scene, session: AnySession) -> System:
    """The system `name`, ready for its first frame. Raises ValueError for an unknown name."""
    definition(name)
    return PROGRAMS[name].create(configuration, scene, session)
