"""One measuring session: a warm-up, then every configuration over the sequence in the protocol's order."""

import math
import time
import uuid
from collections.abc import Callable, Mapping
from pathlib import Path

from client_kit import reasons, repeats
from client_kit.bench import Bench, BrokenError, DeviceBrokenError, FailedError, Outcome
from client_kit.errors import CannotMeasureError
from client_kit.manifest import Manifest
from client_kit.schedule import Schedule
from client_kit.sensors import Sampler
from client_kit.session import MICROSECONDS, Run, Session
from slam.datasets import SequenceError, open_sequence
from slam.devices.choice import choose_device
from slam.devices.device import NoDeviceError
from slam.system import STAGES

# A run that has lost the camera in more of its frames than this is a failure, however fast it was.
MOST_LOST = 0.5

# What runs, frames done, frames in all, seconds until the session is over (None while unknown).
OnFrame = Callable[[str, int, int, float | None], None]


def measure(
    sequence: Path,
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
    """Measure the configurations of `plan`, one after another, over the pack at `sequence`.

    Every configuration first runs over the protocol's warm-up frames, whose results are dropped: programs
    get compiled and clocks rise. After the plan, runs are repeated until the intervals are as tight as the
    protocol wants or its time is up. A configuration that fails on this device is recorded with its reason
    and the others go on, even where it ends or hangs the process that measures; those in `impossible`, with
    their reasons, are not even tried. Where nothing can be measured any more what is left fails with that
    reason, and the finished runs stay. Ctrl-C ends the session, which keeps its finished runs. `on_run` hears
    of every finished run; neither it nor `on_frame` is called within the measured time of a frame.

    Raises CannotMeasureError when no device can compute, or the sequence cannot serve, from the beginning,
    and KeyboardInterrupt when no run was finished.
    """
    protocol = manifest.protocol
    try:
        frames, chosen = len(open_sequence(sequence)), choose_device(device)
    except (SequenceError, NoDeviceError) as error:
        raise CannotMeasureError(str(error)) from error
    if frames < protocol.frames:
        raise CannotMeasureError(
            f"the sequence has {frames} frames, the protocol measures {protocol.frames}: "
            "the server's manifest is wrong"
        )
    started_at, began = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()), time.monotonic()
    runs: list[Run] = []
    interrupted = False
    with Bench(manifest.application, sequence, chosen.label) as bench:
        course = _Course(bench, manifest, impossible or {}, on_frame, root)
        try:
            course.warm_up(plan)
            measuring = time.monotonic()
            following = list(plan)
            course.schedule.add(following, protocol.frames)
            while following:
                for name in following:
                    if runs:
                        rest(protocol.rest_seconds)
                    runs.append(course.run(name, runs))
                    if on_run is not None:
                        on_run(runs[-1])
                now = time.monotonic()
                left = protocol.max_seconds - (now - began)
                following = repeats.further(runs, protocol, left, (now - measuring) / len(runs))
                course.schedule.add(following, protocol.frames)
        except KeyboardInterrupt:
            if not runs:
                raise
            interrupted = True
    samples = tuple(course.sampler.samples)
    return Session(str(uuid.uuid4()), started_at, chosen.backend, tuple(runs), samples, interrupted)


class _Course:
    """The runs of a session at a bench, and what is told and sampled between their frames."""

    def __init__(
        self,
        bench: Bench,
        manifest: Manifest,
        impossible: Mapping[str, str],
        on_frame: OnFrame | None,
        root: Path,
    ) -> None:
        self.sampler = Sampler(root)
        self.schedule = Schedule(manifest.protocol.rest_seconds)
        self._bench, self._manifest, self._on_frame = bench, manifest, on_frame
        self._hopeless = dict(impossible)  # what is not tried any more, with the reasons
        self._warm: set[str] = set()

    def warm_up(self, plan: tuple[str, ...]) -> None:
        """Run each configuration over the warm-up frames; one that fails will not be tried again."""
        names = [name for name in dict.fromkeys(plan) if name not in self._hopeless]
        self.schedule.add(names, self._manifest.protocol.warmup_frames)
        for name in names:
            try:
                self._warm_up(name)
            except FailedError as error:
                self._hopeless[name] = str(error)
            finally:
                self.schedule.end()

    def run(self, name: str, before: list[Run]) -> Run:
        """Measure one configuration, after the runs BEFORE."""
        repeat, order = sum(run.configuration == name for run in before), len(before)
        frames = self._manifest.protocol.frames
        try:
            if name not in self._warm:  # the process in which it was warmed up is gone
                self._warm_up(name)
            result: Outcome | str = self._over(name, frames, f"run {order + 1}, {name}")
        except FailedError as error:
            result = str(error)
        except CannotMeasureError as error:
            if not before:
                raise
            result = self._nothing_runs(reasons.public(str(error)))
        finally:
            self.schedule.end()
        return _recorded(str(uuid.uuid4()), name, repeat, order, result)

    def _warm_up(self, name: str) -> None:
        frames = self._manifest.protocol.warmup_frames
        if frames:
            self._over(name, frames, f"warm-up, {name}")
        self._warm.add(name)

    def _over(self, name: str, frames: int, label: str) -> Outcome:
        def between_frames(done: int, total: int) -> None:
            self.sampler.sample()
            if self._on_frame is not None:
                self._on_frame(label, done, total, self.schedule.left(done))

        if name in self._hopeless:
            raise FailedError(self._hopeless[name])
        self.schedule.begin()
        try:
            return self._bench.measure(self._manifest.configurations[name].parameters, frames, between_frames)
        except BrokenError as error:
            self._hopeless[name] = str(error)
            self._warm.clear()
            raise
        except DeviceBrokenError as error:
            self._nothing_runs(str(error))
            raise

    def _nothing_runs(self, reason: str) -> str:
        """Note, and give back, the REASON why no configuration is tried any more."""
        self._hopeless = dict.fromkeys(self._manifest.configurations, reason) | self._hopeless
        return reason


def _recorded(run_id: str, configuration: str, repeat: int, order: int, result: Outcome | str) -> Run:
    """The run that a measurement, or the reason why there is none, makes."""
    if isinstance(result, str):
        return Run(run_id, configuration, repeat, order, "failed", failure=result)
    frames, ate = result.report["frames"], result.report["ate"] or {}
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
        trajectory_sha256=result.trajectory_sha256,
    )
