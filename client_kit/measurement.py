"""One measuring session: a warm-up, then every configuration over the sequence in the protocol's order."""

import hashlib
import math
import time
import uuid
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path

import numpy as np

from client_kit import repeats
from client_kit.errors import CannotMeasureError
from client_kit.manifest import Manifest
from client_kit.schedule import Schedule
from client_kit.sensors import Sampler
from client_kit.session import MICROSECONDS, Run, Session
from slam import benchmark, disclosure, opencl
from slam.benchmark import Report
from slam.datasets.sequence import Sequence, SequenceError
from slam.opencl import NoDeviceError
from slam.system import STAGES
from slam.systems import open_session

LONGEST_FAILURE = 300
# A run that has lost the camera in more of its frames than this is a failure, however fast it was.
MOST_LOST = 0.5

# What runs, frames done, frames in all, seconds until the session is over (None while unknown).
OnFrame = Callable[[str, int, int, float | None], None]


def measure(
    sequence: Sequence,
    manifest: Manifest,
    plan: tuple[str, ...],
    *,
    device: str | None = None,
    impossible: Mapping[str, str] | None = None,
    on_run: Callable[[Run], None] | None = None,
    on_frame: OnFrame | None = None,
    rest: Callable[[float], None] = time.sleep,
    root: Path = Path("/"),
) -> Session:
    """Measure the configurations of `plan`, one after another, in this process.

    Every configuration first runs over the protocol's warm-up frames, whose results are dropped: programs
    get compiled and clocks rise. After the plan, runs are repeated until the intervals are as tight as the
    protocol wants or its time is up. A configuration that fails on this device is recorded with its reason
    and the others go on; those in `impossible`, with their reasons, are not even tried. Ctrl-C ends the
    session, which keeps its finished runs. `on_run` hears of every finished run; neither it nor `on_frame`
    is called within the measured time of a frame.

    Raises CannotMeasureError when no device can compute, or the sequence cannot serve, and
    KeyboardInterrupt when no run was finished.
    """
    protocol = manifest.protocol
    if len(sequence) < protocol.frames:
        raise CannotMeasureError(
            f"the sequence has {len(sequence)} frames, the protocol measures {protocol.frames}: "
            "the server's manifest is wrong"
        )
    bench = _Bench(sequence, manifest, device, dict(impossible or {}), on_frame, root)
    started_at, began = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()), time.monotonic()
    runs: list[Run] = []
    interrupted = False
    try:
        bench.warm_up(plan)
        measuring = time.monotonic()
        following = list(plan)
        bench.schedule.add(following, protocol.frames)
        while following:
            for name in following:
                if runs:
                    rest(protocol.rest_seconds)
                runs.append(bench.run(name, runs))
                if on_run is not None:
                    on_run(runs[-1])
            now = time.monotonic()
            left = protocol.max_seconds - (now - began)
            following = repeats.further(runs, protocol, left, (now - measuring) / len(runs))
            bench.schedule.add(following, protocol.frames)
    except KeyboardInterrupt:
        if not runs:
            raise
        interrupted = True
    samples = tuple(bench.sampler.samples)
    return Session(str(uuid.uuid4()), started_at, bench.backend, tuple(runs), samples, interrupted)


class _Bench:
    """The device, opened once for all runs of a session, and again after an error."""

    def __init__(
        self,
        sequence: Sequence,
        manifest: Manifest,
        device: str | None,
        failures: dict[str, str],
        on_frame: OnFrame | None,
        root: Path,
    ) -> None:
        self.sampler = Sampler(root)
        self.schedule = Schedule(manifest.protocol.rest_seconds)
        self._sequence, self._manifest, self._on_frame = sequence, manifest, on_frame
        self._failures = failures
        try:
            self._device = opencl.choose_device(device)
        except NoDeviceError as error:
            raise CannotMeasureError(str(error)) from error
        self._opened: opencl.Session | None = None
        self.backend = self._device.backend

    def warm_up(self, plan: tuple[str, ...]) -> None:
        """Run each configuration over the warm-up frames; one that fails will not be tried again."""
        frames = self._manifest.protocol.warmup_frames
        names = [name for name in dict.fromkeys(plan) if name not in self._failures]
        if not frames:
            return
        self.schedule.add(names, frames)
        for name in names:
            outcome = self._attempt(name, frames, f"warm-up, {name}")
            if isinstance(outcome, str):
                self._failures[name] = outcome

    def run(self, name: str, before: list[Run]) -> Run:
        """Measure one configuration, after the runs BEFORE."""
        repeat, order = sum(run.configuration == name for run in before), len(before)
        failure = self._failures.get(name)
        if failure is not None:
            self.schedule.end()
        label = f"run {order + 1}, {name}"
        result = failure or self._attempt(name, self._manifest.protocol.frames, label)
        return _recorded(str(uuid.uuid4()), name, repeat, order, result)

    def _attempt(self, name: str, frames: int, label: str) -> Report | str:
        def between_frames(done: int, total: int) -> None:
            self.sampler.sample()
            if self._on_frame is not None:
                self._on_frame(label, done, total, self.schedule.left(done))

        application = self._manifest.application
        self.schedule.begin()
        try:
            if self._opened is None:
                self._opened = open_session(application, self._device)
            return benchmark.run(
                self._manifest.configurations[name].parameters,
                self._sequence,
                system=application,
                frames=frames,
                device=self._opened,
                progress=between_frames,
            )
        except SequenceError as error:
            raise CannotMeasureError(str(error)) from error
        except Exception as error:  # whatever a driver raises says something of this configuration here
            self._opened = None  # an error may leave the driver's context unusable
            return _failure(error)
        finally:
            self.schedule.end()


def _recorded(run_id: str, configuration: str, repeat: int, order: int, result: Report | str) -> Run:
    """The run that a report, or the reason why there is none, makes."""
    if isinstance(result, str):
        return Run(run_id, configuration, repeat, order, "failed", failure=result)
    report = result.to_dict()
    frames, ate = report["frames"], report["ate"] or {}
    errors = [ate.get(name) for name in ("max", "mean", "rmse")]
    if not all(error is None or math.isfinite(error) for error in errors):
        return Run(run_id, configuration, repeat, order, "failed", failure="the trajectory is not finite")
    tracked = tuple(frame["tracked"] for frame in frames)
    lost, attempted = tracked.count(False), len(tracked) - tracked.count(None)
    failed = lost > MOST_LOST * attempted
    return Run(
        run_id,
        configuration,
        repeat,
        order,
        "failed" if failed else "ok",
        failure=f"tracking lost in {lost} of {attempted} frames" if failed else None,
        frame_us=tuple(round(frame["computation"] * MICROSECONDS) for frame in frames),
        # Rounded down, so that the stages never add up to more than the frame.
        stages_us={
            stage: tuple(math.floor(frame[stage] * MICROSECONDS) for frame in frames) for stage in STAGES
        },
        tracked=tracked,
        ate_max=errors[0],
        ate_mean=errors[1],
        ate_rmse=errors[2],
        trajectory_sha256=hashlib.sha256(np.ascontiguousarray(result.poses, "<f8").tobytes()).hexdigest(),
    )


def _failure(error: Exception) -> str:
    """The reason in a line, without folders, of which one often is the user's name."""
    text = f"{type(error).__name__}: {error}"
    with suppress(RuntimeError):  # nobody knows where the user's folder is
        home = str(Path.home())
        # The text of an OSError quotes its path by repr(), which doubles the separators of Windows.
        text = text.replace(repr(home)[1:-1], "~").replace(home, "~")
    return " ".join(disclosure.public(text).split())[:LONGEST_FAILURE]
