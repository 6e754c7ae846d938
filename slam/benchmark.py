"""Run one configuration of a SLAM system over a sequence and report its time and its trajectory error."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Mapping
from collections.abc import Sequence as Several
from dataclasses import dataclass, field, replace
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import numpy.typing as npt

from slam.camera import Camera
from slam.datasets.sequence import Progress, Sequence, SequenceError
from slam.definitions import definition, require_backend
from slam.devices.build import DEFAULT, Build
from slam.devices.choice import AnySession, choose_device
from slam.devices.opencl import Session
from slam.devices.tuning import wavy_wall
from slam.kfusion.pipeline import FOLDERS
from slam.plans.executors import prepare
from slam.power import EnergyMeter
from slam.processor_time import ProcessorClock, Used
from slam.registry import create, fit, frame_plan, open_session
from slam.stopping import Condition, EarlyStop, Stop
from slam.system import (
    DEFAULT_INITIAL_POSITION,
    DEFAULT_VOLUME_SIZE,
    STAGES,
    Bounded,
    LoopCounts,
    Revising,
    Scene,
    System,
    scene_of,
)
from slam.trajectories.trajectory import AbsoluteTrajectoryError, Trajectory, absolute_trajectory_error
from slam.validity import Verdict, judge
from wire.protocol import DECODED_AHEAD, FIRST_COUNTED_FRAME, RUNTIMES, VALID_BELOW

Observer = Callable[
    [int, System], None
]  # called with the number of the frame just done and the running system


@dataclass(frozen=True)
class FrameTimes:
    """Seconds of one frame. `stages` by the report's `stage_clock`, empty where that is "none"; the rest is
    wall time. `computation` lasts from the first upload until the pose is known; `total` adds acquisition and
    rendering.

    `tracked` is True, False (lost) or None (tracking not attempted, or the frame skipped). `degenerate` is
    whether a tracked pose is free to move in some direction, None where that is not known. `refusal` is why a
    lost frame's pose was refused, None where that is not known. `outside` is the share of what was measured
    that lies beyond the volume, None for a system without one. `skipped`: nothing was computed, because the
    camera moved little.
    """

    acquisition: float
    stages: Mapping[str, float]
    rendering: float
    computation: float
    total: float
    tracked: bool | None
    integrated: bool
    degenerate: bool | None = None
    refusal: str | None = None
    outside: float | None = None
    skipped: bool = False

    def to_dict(self) -> dict[str, Any]:
        stages = {stage: self.stages.get(stage) for stage in STAGES}
        return {
            "acquisition": self.acquisition,
            **stages,
            "rendering": self.rendering,
            "computation": self.computation,
            "total": self.total,
            "tracked": self.tracked,
            "skipped": self.skipped,
            "integrated": self.integrated,
            "degenerate": self.degenerate,
            "refusal": self.refusal,
            "outside": self.outside,
        }


@dataclass(frozen=True)
class Report:
    """The measurements of a run.

    `poses` (n, 4, 4) are the final trajectory, in the system's own world. A system that closes loops corrects
    earlier poses: `ate_online` is the error of the poses as reported after each frame (None for a system that
    corrects nothing). `loops` counts the loops that such a system closed, None for others. Errors are None
    where no frame has a true pose. `cpu_seconds` counts all threads during the computation of the frames
    only. `cpu_us` and `waited_us` are those of `slam.processor_time`, over the counted frames and what lies
    between them, None where unknown. `peak_memory_bytes` is the resident size of the whole process at its
    largest, `energy_joules` what `energy_source` (see `slam.power`) took during the computation; they are
    None where the platform does not report them. `stop`: where and why it ended early; everything is then of
    the frames before. `build`: the build options, and what the compiler and the launches made of them; None
    for a backend without any.
    """

    system: str
    configuration: Mapping[str, Any]
    sequence: Mapping[str, Any]
    device: Mapping[str, Any]
    frames: tuple[FrameTimes, ...]
    timestamps: npt.NDArray[np.float64] = field(repr=False)
    poses: npt.NDArray[np.float64] = field(repr=False)
    ate: AbsoluteTrajectoryError | None
    ate_online: AbsoluteTrajectoryError | None
    loops: LoopCounts | None
    stage_clock: str
    cpu_seconds: float
    cpu_us: int | None
    waited_us: int | None
    peak_memory_bytes: int | None
    energy_joules: float | None
    energy_source: str | None
    stop: Stop | None = None
    build: Mapping[str, Any] | None = None

    @property
    def runtime(self) -> float:
        """Mean computation seconds from frame 10 on, or over all frames when there are no more than 10."""
        return sum(self._computation) / len(self._computation)

    @property
    def runtime_p95(self) -> float:
        """The 95th percentile of the same times."""
        return float(np.quantile(self._computation, 0.95))

    @property
    def runtime_max(self) -> float:
        """The largest of the same times."""
        return max(self._computation)

    @property
    def _computation(self) -> list[float]:
        return [frame.computation for frame in self.frames[FIRST_COUNTED_FRAME:] or self.frames]

    @property
    def matched_poses(self) -> int:
        """The number of frames that were compared with a true pose."""
        return 0 if self.ate is None else int(np.isfinite(self.ate.per_frame).sum())

    @property
    def verdict(self) -> Verdict:
        """Whether the run is valid, and why it is not: see `slam.validity.judge`."""
        largest = None if self.ate is None else self.ate.max
        verdict = judge([frame.tracked for frame in self.frames], self.matched_poses, largest)
        certain = verdict.valid is False and largest is not None and largest >= VALID_BELOW
        return verdict if self.stop is None or certain else Verdict(None, str(self.stop))

    @property
    def valid(self) -> bool | None:
        """Whether it was tracked, compared, and below 5 cm in every frame; None where it was not compared."""
        return self.verdict.valid

    def trajectory(self) -> Trajectory:
        return Trajectory(self.timestamps, self.poses)

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values; a frame's `error` is its distance from the truth in metres, or null."""
        ate = self.ate
        errors = np.full(len(self.frames), np.nan) if ate is None else ate.per_frame
        frames = [
            frame.to_dict() | {"error": float(error) if np.isfinite(error) else None}
            for frame, error in zip(self.frames, errors, strict=True)
        ]
        return {
            "system": self.system,
            "configuration": dict(self.configuration),
            "sequence": dict(self.sequence),
            "device": dict(self.device),
            **({} if self.build is None else {"build": dict(self.build)}),
            "frames": frames,
            "stage_clock": self.stage_clock,
            **{name: getattr(self, name) for name in RUNTIMES},
            "ate": _figures(ate),
            **({} if self.ate_online is None else {"ate_online": _figures(self.ate_online)}),
            **({} if self.loops is None else {"loops": self.loops.to_dict()}),
            "matched_poses": self.matched_poses,
            "matched_share": self.matched_poses / len(self.frames),
            "valid": self.valid,
            "not_valid_because": self.verdict.reason,
            **({} if self.stop is None else {"stopped": vars(self.stop)}),
            "cpu_seconds": self.cpu_seconds,
            "cpu_us": self.cpu_us,
            "waited_us": self.waited_us,
            "peak_memory_bytes": self.peak_memory_bytes,
            "energy_joules": self.energy_joules,
            "energy_source": self.energy_source,
        }


def _figures(ate: AbsoluteTrajectoryError | None) -> dict[str, float] | None:
    if ate is None:
        return None
    return {name: getattr(ate, name) for name in ("mean", "max", "rmse", "rmse_aligned")}


def run(
    configuration: Mapping[str, Any],
    sequence: Sequence,
    *,
    system: str = "kfusion",
    frames: int | None = None,
    device: str | AnySession | None = None,
    backend: str = "opencl",
    build: Build = DEFAULT,
    volume_size: float | None = None,
    initial_position: tuple[float, float, float] | None = None,
    progress: Progress | None = None,
    observe: Observer | None = None,
    decoded_ahead: int = DECODED_AHEAD,
    stop_above: Several[Condition] = (),
    compiling: Progress | None = None,
    first_counted: int = FIRST_COUNTED_FRAME,
) -> Report:
    """Feed the first `frames` frames (default all) to a system and measure it.

    `device` is a part of the description of a device of `backend`, or an open session, which several runs may
    share one after another; `build` is only for a session that is opened here. `volume_size` is in metres and
    `initial_position` a fraction of it; both default to the sequence's own, then to DEFAULT_*. Images are
    cropped where the configuration cannot divide their size; those of a pack are not. `observe` sees the
    system after every frame, to draw pictures: its time is a frame's `rendering`, which does not count as
    computation. `compiling` is called between the steps in which the driver compiles. The run ends early once
    one of `stop_above` is certainly broken: see `slam.stopping`. `cpu_us` and `waited_us` begin with the
    frame `first_counted`. OpenCL does not survive a fork: call this in a process that never forks afterwards.
    Raises SequenceError for a bad number of frames, a damaged frame, or missing colour that the system needs.
    Raises ValueError for an unknown system, ConfigurationError for a bad parameter, DeviceError where the
    device is missing or too small.
    """
    count = len(sequence) if frames is None else frames
    if not 1 <= count <= len(sequence):
        raise SequenceError(f"frames={count}: give 1 to {len(sequence)}, the frames of {sequence.name!r}")
    coloured = definition(system).colour
    if coloured and all(sequence.colour(index) is None for index in range(len(sequence))):
        raise SequenceError(
            f"{sequence.name!r} has no colour, which {system} needs: give a sequence with colour; that of a "
            "pack lies beside it in the folder NAME-colour"
        )
    sequence = fit(system, configuration, sequence)
    scene = scene_of(sequence, volume_size, initial_position)
    if isinstance(device, str | None):
        session = open_session(system, choose_device(device, backend), build=build)
    else:
        require_backend(system, device.device.backend)
        session = device
    running = create(system, configuration, scene, session)
    _warm_up(system, running.configuration(), session, compiling)

    meter = EnergyMeter()
    _reset_peak_memory()
    cpu_seconds = 0.0
    joules: float | None = 0.0
    times, poses = [], []
    revising = running if isinstance(running, Revising) else None
    early = EarlyStop(
        stop_above,
        count,
        None if revising or sequence.truth is None else sequence.truth[:count],
        timed=not definition(system).skips(running.configuration()),
    )
    clock, processor_time = ProcessorClock(), Used(None, None)
    for index, image in enumerate(_decoded(sequence, system, count, coloured, decoded_ahead)):
        energy, cpu = meter.read(), time.process_time()
        computing = time.perf_counter()
        result = running.process(image.depth, image.colour)
        computed = time.perf_counter()
        cpu_seconds += time.process_time() - cpu
        used = meter.joules(energy, meter.read())
        joules = None if joules is None or used is None else joules + used
        poses.append(result.pose)
        rendering = 0.0
        if observe:
            began_rendering = time.perf_counter()
            observe(index, running)
            rendering = time.perf_counter() - began_rendering
        times.append(
            FrameTimes(
                acquisition=image.seconds,
                stages=result.seconds,
                rendering=rendering,
                computation=result.computation,
                total=image.seconds + computed - computing + rendering,
                tracked=result.tracked,
                integrated=result.integrated,
                degenerate=result.degenerate,
                refusal=result.refusal,
                outside=running.outside(image.depth) if isinstance(running, Bounded) else None,
                skipped=result.skipped,
            )
        )
        done = index + 1
        stop = early.after(poses, [one.computation for one in times[FIRST_COUNTED_FRAME:]])
        if done > first_counted and (stop or done == count):
            processor_time = clock.stop()
        if progress:
            progress(done, count)
        if done == first_counted:
            clock.start()
        if stop:
            break
    count = len(times)
    online = np.array(poses)
    estimate = revising.poses() if revising else online
    return Report(
        system=system,
        configuration=running.configuration(),
        sequence={
            "name": sequence.name,
            "frames": len(sequence),
            "width": sequence.camera.width,
            "height": sequence.camera.height,
            "sha256": sequence.sha256,
            **({} if sequence.cropped_from is None else {"cropped_from": list(sequence.cropped_from)}),
        },
        device=session.device.describe(),
        frames=tuple(times),
        timestamps=sequence.timestamps[:count],
        poses=estimate,
        ate=_error(estimate, sequence, count),
        ate_online=_error(online, sequence, count) if revising else None,
        loops=revising.loop_counts() if revising else None,
        stage_clock=running.stage_clock,
        cpu_seconds=cpu_seconds,
        **processor_time._asdict(),
        peak_memory_bytes=_peak_memory(),
        energy_joules=joules,
        energy_source=None if joules is None else meter.source,
        stop=stop,
        build=_build(session) if isinstance(session, Session) else None,
    )


def _build(session: Session) -> dict[str, Any]:
    """The build options of a session, the compiler's options, and the layout: rows, or WIDTHxHEIGHT."""
    layout = session.layout
    return {
        **session.build.to_dict(),
        "options": " ".join(session.build.options),
        "layout": "x".join(map(str, layout.group)) if layout.pixels else layout.kind,
    }


def _error(
    estimate: npt.NDArray[np.float64], sequence: Sequence, count: int
) -> AbsoluteTrajectoryError | None:
    if sequence.truth is None or not np.isfinite(sequence.truth[:count]).any():
        return None
    return absolute_trajectory_error(estimate, sequence.truth[:count])


@dataclass(frozen=True)
class _Image:
    """The images of one frame, and the seconds that decoding them took."""

    depth: npt.NDArray[np.uint16]
    colour: npt.NDArray[np.uint8] | None
    seconds: float


def _decoded(sequence: Sequence, system: str, count: int, coloured: bool, ahead: int) -> Iterator[_Image]:
    """The first `count` frames of `sequence`, decoded `ahead` at a time.

    A device that decodes between two frames rests meanwhile, which favours a slow configuration.
    """
    for begin in range(0, count, ahead):
        images = []
        for index in range(begin, min(begin + ahead, count)):
            began = time.perf_counter()
            depth = sequence.depth(index)
            colour = _colour_of(sequence, index, system) if coloured else None
            images.append(_Image(depth, colour, time.perf_counter() - began))
        yield from images


def _colour_of(sequence: Sequence, index: int, system: str) -> npt.NDArray[np.uint8]:
    colour, stamp = sequence.colour(index), sequence.timestamps[index]
    if colour is None:
        raise SequenceError(
            f"frame {index} of {sequence.name!r}, at {stamp:.6f} s, has no colour image, which {system} "
            "needs beside every depth image: add it, or leave the frame out (where there is a depth.txt, "
            "delete its line there)"
        )
    return colour


def _warm_up(
    system: str, configuration: Mapping[str, Any], session: AnySession, compiling: Progress | None
) -> None:
    """Make the OpenCL driver compile every kernel: some drivers wait until a kernel first runs.

    It processes a few small frames, whose levels have both kinds of size that KinectFusion's plan knows: a
    wall with a box in front, the wall alone, nothing for longer than the time window, and the wall again,
    which closes a loop. They take some tenths of a second once the driver's cache is warm.
    """
    scene = Scene(Camera(128, 128, 64, 48, 128, 96), DEFAULT_VOLUME_SIZE, DEFAULT_INITIAL_POSITION)
    running = create(system, definition(system).warm_up(configuration), scene, session)
    wall, painted = wavy_wall(scene.camera)
    boxed, dark = wall.copy(), np.zeros_like(wall)
    boxed[24:72, 32:96] = 1000
    images = [boxed] * 3 + [wall] * 3 + [dark] * 14 + [wall] * 4
    for done, depth in enumerate(images):
        if compiling:
            compiling(done, len(images))
        running.process(depth, painted)


def _reset_peak_memory() -> None:
    """Reset Linux's record of the peak memory, so that each run in one process has its own."""
    if sys.platform == "linux":
        try:
            Path("/proc/self/clear_refs").write_text("5")
        except OSError:  # some sandboxes forbid it: the peak then covers the whole process
            return


def _peak_memory() -> int | None:
    if sys.platform == "linux":
        status = Path("/proc/self/status").read_text()
        return int(status.split("VmHWM:")[1].split()[0]) * 1024
    if sys.platform == "win32":
        return None
    import resource

    return int(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss) * (1 if sys.platform == "darwin" else 1024)


def empty_frame_seconds(session: AnySession, frames: int = 50) -> float:
    """Median wall seconds of an empty frame: a depth image of 640x480 is uploaded to the device of `session`
    and the state is read back, without any kernel. Every frame pays this cost of backend and driver.
    """
    camera = Camera(500.0, 500.0, 319.5, 239.5, 640, 480)
    scene = Scene(camera, DEFAULT_VOLUME_SIZE, DEFAULT_INITIAL_POSITION)
    plan = frame_plan("kfusion", {"compute_size_ratio": 8, "volume_resolution": 32}, scene, session.layout)
    idle = prepare(replace(plan, dispatches=()), session, FOLDERS)
    image = np.zeros((camera.height, camera.width), np.uint16)
    return median(idle.run(number, image).computation for number in range(frames))
