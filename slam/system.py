"""The interface of SLAM systems: what is known of them, their input, and what they offer to the benchmark."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from slam.camera import Camera
from slam.datasets.sequence import Sequence

# The default for a scene without a volume: the cube of the published app, with the camera inside its near
# face, looking in.
DEFAULT_VOLUME_SIZE = 5.0
DEFAULT_INITIAL_POSITION = (0.5, 0.5, 0.1)
STAGES = ("preprocessing", "tracking", "integration", "raycasting")


@dataclass(frozen=True)
class Frame:
    """The result of one frame.

    pose: float64 (4, 4), camera to world, after the frame. tracked: True, False (lost), or None where
    tracking was not attempted. seconds: time of each of STAGES by the system's `stage_clock`, empty where
    that is "none". computation: wall time from the first upload until the pose was read back. degenerate:
    whether a tracked pose is free to move in some direction, as in front of a flat wall; None where the frame
    was not tracked, or the system does not report it. refusal: why the pose of a lost frame was refused, in
    words; None where it was tracked, or the system does not report it. skipped: nothing was computed, the
    pose is where the motion before leads.
    """

    pose: NDArray[np.float64]
    tracked: bool | None
    integrated: bool
    seconds: dict[str, float]
    computation: float
    degenerate: bool | None = None
    refusal: str | None = None
    skipped: bool = False


@dataclass(frozen=True)
class View:
    """The model as the camera sees it: float32 maps (height, width, 3), zero where there is nothing.

    vertices: metres in the system's world. normals: of unit length. eye: the camera's centre (3,). colour:
    uint8 (height, width, 3), red green blue, of a system that keeps it.
    """

    vertices: NDArray[np.float32]
    normals: NDArray[np.float32]
    eye: NDArray[np.float32]
    colour: NDArray[np.uint8] | None = None


class System(Protocol):
    """A SLAM system that is fed images one by one."""

    @property
    def stage_clock(self) -> str:
        """The clock of the stages: "device", "wall" (the host), or "none"."""

    def process(self, depth: NDArray[np.uint16], colour: NDArray[np.uint8] | None = None) -> Frame:
        """Take the next depth image, (height, width) in millimetres, 0 where nothing was measured.

        `colour` is the image that belongs to it, (height, width, 3), red green blue; systems that need it are
        marked in `slam.registry`, the others ignore it.
        """

    def configuration(self) -> dict[str, Any]:
        """The parameters that this system runs with, by their names in the design space."""

    def view(self) -> View | None:
        """The camera's current view of the model; None before there is one."""


@dataclass(frozen=True)
class LoopCounts:
    """The numbers of closed loops and of relocalisations.

    local: loops closed between the map of the last frames and an older part of it. global_: loops closed by
    recognising an earlier view.
    """

    local: int = 0
    global_: int = 0
    relocalisations: int = 0

    def to_dict(self) -> dict[str, int]:
        """Plain JSON values, with the key "global" for global_."""
        return {"local": self.local, "global": self.global_, "relocalisations": self.relocalisations}


@runtime_checkable
class Revising(Protocol):
    """A system that corrects poses of earlier frames when it closes a loop."""

    def loop_counts(self) -> LoopCounts:
        """The loops closed and relocalisations so far."""

    def poses(self) -> NDArray[np.float64]:
        """The current estimates of all poses so far: (n, 4, 4), camera to world."""


@runtime_checkable
class Bounded(Protocol):
    """A system whose model is a volume of a fixed place and size."""

    def outside(self, depth: NDArray[np.uint16]) -> float:
        """The share of what `depth` (height, width; millimetres) shows from the last pose that lies beyond
        the volume. 0 where nothing was measured."""


@runtime_checkable
class Exporting(Protocol):
    """A system that writes its own reconstruction."""

    def export(self, path: Path) -> str:
        """Write the reconstruction as a PLY file; returns a sentence about its content."""


@dataclass(frozen=True)
class Scene:
    """The camera, and the cube that is reconstructed.

    volume_size: side in metres. initial_position: the first camera centre as a fraction of the cube.
    """

    camera: Camera
    volume_size: float
    initial_position: tuple[float, float, float]


def scene_of(
    sequence: Sequence,
    volume_size: float | None = None,
    initial_position: tuple[float, float, float] | None = None,
) -> Scene:
    """The scene of `sequence`: the given volume size (m) and initial position (fractions), or else the
    sequence's own, or else DEFAULT_*."""
    if volume_size is None:
        volume_size = sequence.volume_size or DEFAULT_VOLUME_SIZE
    if initial_position is None:
        initial_position = sequence.initial_position or DEFAULT_INITIAL_POSITION
    return Scene(sequence.camera, volume_size, initial_position)


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
    """What is known of a system without any device.

    `title`: its name in papers. `complete`: all parameters of a configuration, with defaults; raises
    ConfigurationError for a bad one. `backends`: those it runs on. `colour`: whether it needs colour images
    beside depth. `size_multiple`: what the sides of its images must be multiples of, in pixels, for a
    complete configuration. `warm_up`: for a complete configuration, one that launches all of its kernels
    within a few frames. `parameters`: those of its design spaces. `optional`: those of them that a complete
    configuration leaves out where they are 0. `stages`: what happens in each. `unattempted`: why some frames
    are not tracked. `skips`: whether a configuration leaves out frames by the camera's motion. `revises`:
    whether closed loops move earlier poses, the first one too. `plan`: a frame as data for a scene and a
    layout, None for a system that the host drives. `known`: configurations of others, by label. `packages`:
    those it needs beyond the base installation, with the module of each.
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
    optional: tuple[str, ...] = ()
    skips: Callable[[Mapping[str, Any]], bool] = lambda _: False
    revises: bool = False
    plan: Callable[[Mapping[str, Any], Scene, Any], Any] | None = None
    known: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    packages: Mapping[str, str] = field(default_factory=dict)
