"""The SLAM systems that exist, by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from slam.configuration import ConfigurationError
from slam.datasets import Sequence
from slam.datasets.cropped import cropped
from slam.devices import choice
from slam.devices.choice import AnySession
from slam.devices.device import BACKENDS, Device
from slam.devices.layout import Layout
from slam.devices.opencl import SHARED, Session
from slam.devices.tuning import SCENE, Progress, Trial, layout_for
from slam.elasticfusion.configuration import Configuration as ElasticConfiguration
from slam.elasticfusion.pipeline import ElasticFusion
from slam.kfusion.configuration import Configuration as KFusionConfiguration
from slam.kfusion.pipeline import KFusion
from slam.kfusion.plan import plan
from slam.plans.plan import Plan
from slam.system import Scene, System


@dataclass(frozen=True)
class Definition:
    """The definition of a system: its complete configuration, its constructor, and a trial of its layouts.

    `backends`: those it runs on. `plan`: a frame as data, None for a system that the host drives. `warm_up`:
    for a complete configuration, one that launches all of its kernels within a few frames. `colour`:
    whether it needs colour images beside depth. `size_multiple`: what the sides of its images must be
    multiples of, in pixels, for a complete configuration. `values`: those of its design space, by parameter,
    ascending, with 0 and 1 for a flag.
    """

    complete: Callable[[Mapping[str, Any]], dict[str, Any]]
    create: Callable[[Mapping[str, Any], Scene, Any], System]
    backends: tuple[str, ...]
    plan: Callable[[Mapping[str, Any], Scene, Layout], Plan] | None
    trial: Trial
    warm_up: Callable[[Mapping[str, Any]], dict[str, Any]]
    colour: bool
    size_multiple: Callable[[Mapping[str, Any]], int]
    values: Mapping[str, tuple[float, ...]]


def _kfusion(values: Mapping[str, Any], scene: Scene, session: AnySession) -> System:
    return KFusion(KFusionConfiguration.from_mapping(values), scene, session)


def _elasticfusion(values: Mapping[str, Any], scene: Scene, session: Session) -> System:
    return ElasticFusion(ElasticConfiguration.from_mapping(values), scene, session)


def _elastic_warm_up(open_loop: bool) -> ElasticConfiguration:
    """A small map that is left and revisited within a few frames, with every loop accepted."""
    return ElasticConfiguration(
        open_loop=open_loop,
        relocalisation=False,
        time_window=12,
        confidence_threshold=1,
        icp_count_threshold=0,
        icp_error_threshold=1.0,
        icp_deviation_threshold=1.0,
        fern_deviation_threshold=1.0,
        surfel_capacity=50_000,
    )


FOLDER = Path(__file__).parent
TRIED = KFusionConfiguration(integration_rate=1, volume_resolution=128)
ELASTIC_TRIED = ElasticConfiguration(open_loop=True, surfel_capacity=200_000)
FLAG = (0, 1)

SYSTEMS = {
    "kfusion": Definition(
        complete=lambda values: KFusionConfiguration.from_mapping(values).to_dict(),
        create=_kfusion,
        backends=BACKENDS,
        plan=lambda values, scene, layout: plan(KFusionConfiguration.from_mapping(values), scene, layout),
        trial=Trial(lambda session: KFusion(TRIED, SCENE, session), (FOLDER / "kfusion" / "kernels", SHARED)),
        warm_up=lambda _: TRIED.to_dict(),
        colour=False,
        size_multiple=lambda values: int(values["compute_size_ratio"]),
        values={
            "volume_resolution": (64, 128, 256, 512),
            "compute_size_ratio": (1, 2, 4, 8),
            "mu": (0.025, 0.05, 0.1, 0.2, 0.3, 0.4),
            "icp_threshold": (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1),
            "integration_rate": (1, 2, 5, 10, 20),
            "tracking_rate": (1, 2, 3, 5, 9),
            "pyramid_iterations_fine": (2, 4, 6, 8, 10),
            "pyramid_iterations_middle": (1, 3, 5, 7, 9),
            "pyramid_iterations_coarse": (0, 2, 4, 6, 8),
        },
    ),
    "elasticfusion": Definition(
        complete=lambda values: ElasticConfiguration.from_mapping(values).to_dict(),
        create=_elasticfusion,
        backends=("opencl",),
        plan=None,
        trial=Trial(
            lambda session: ElasticFusion(ELASTIC_TRIED, SCENE, session),
            (FOLDER / "elasticfusion" / "kernels", SHARED),
        ),
        warm_up=lambda values: _elastic_warm_up(bool(values["open_loop"])).to_dict(),
        colour=True,
        size_multiple=lambda _: 1,
        values={
            "icp_weight": (0, 0.5, *range(1, 21), 50, 100),
            "depth_cutoff": tuple(0.5 * half for half in range(2, 26)),
            "confidence_threshold": tuple(range(1, 25)),
            "disable_so3": FLAG,
            "open_loop": FLAG,
            "relocalisation": FLAG,
            "fast_odometry": FLAG,
            "frame_to_frame_rgb": FLAG,
        },
    ),
}


def complete(name: str, configuration: Mapping[str, Any]) -> dict[str, Any]:
    """All parameters of the system `name`, with defaults for those that `configuration` leaves out.

    Needs no device. Raises ValueError for an unknown name, ConfigurationError for a bad parameter.
    """
    return definition(name).complete(configuration)


def needs_colour(name: str) -> bool:
    """Whether the system `name` needs colour images. Raises ValueError for an unknown name."""
    return definition(name).colour


def warm_up(name: str, configuration: Mapping[str, Any]) -> dict[str, Any]:
    """A configuration that launches within a few frames all kernels that `configuration` can launch.

    Raises ValueError for an unknown name.
    """
    return definition(name).warm_up(configuration)


def fit(name: str, configuration: Mapping[str, Any], sequence: Sequence) -> Sequence:
    """SEQUENCE, cropped as the system `name` with `configuration` needs; a pack is never cropped.

    Raises ValueError for an unknown name, ConfigurationError for a bad parameter.
    """
    return cropped(sequence, definition(name).size_multiple(complete(name, configuration)))


def require_backend(name: str, backend: str) -> None:
    """Raise ConfigurationError where the system `name` does not run on `backend`, ValueError for an unknown
    name.
    """
    backends = definition(name).backends
    if backend not in backends:
        raise ConfigurationError(f"backend {backend}: {name} runs on {' and '.join(backends)} only")


def frame_plan(name: str, configuration: Mapping[str, Any], scene: Scene, layout: Layout) -> Plan:
    """The steps of the system `name` in each frame, as data.

    Raises ValueError for an unknown name, ConfigurationError for a system without a plan and for a bad
    parameter.
    """
    make = definition(name).plan
    if make is None:
        raise ConfigurationError(f"system {name}: the host drives it, so it has no plan; kfusion has one")
    return make(configuration, scene, layout)


def open_session(name: str, device: Device, progress: Progress | None = None) -> AnySession:
    """A session on `device`, with the fastest kernel layout there for the system `name`.

    While layouts are tried, `progress` is called with the numbers done and in total. Raises
    ValueError for an unknown name, ConfigurationError where the system does not run on the device's backend.
    """
    require_backend(name, device.backend)
    if device.backend == "webgpu":
        return choice.open_session(device)
    return choice.open_session(device, layout_for(device, definition(name).trial, progress))


def create(name: str, configuration: Mapping[str, Any], scene: Scene, session: AnySession) -> System:
    """The system `name`, ready for its first frame. Raises ValueError for an unknown name."""
    return definition(name).create(configuration, scene, session)


def definition(name: str) -> Definition:
    """The definition of the system `name`. Raises ValueError, which lists the known ones."""
    if name not in SYSTEMS:
        raise ValueError(f"unknown system {name!r}: choose one of {', '.join(sorted(SYSTEMS))}")
    return SYSTEMS[name]
