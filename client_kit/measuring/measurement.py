"""One measuring session: a warm-up, then every configuration over the sequence in the protocol's order.

What other programs disturbed is measured again at the end.
"""

import time
import uuid
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from client_kit.delivery.manifest import Manifest, Protocol
from client_kit.delivery.reference_trajectories import Positions
from client_kit.device.sensors import Sampler
from client_kit.errors import CannotMeasureError
from client_kit.measuring import reasons
from client_kit.measuring.run_record import recorded
from client_kit.measuring.schedule import Schedule
from client_kit.measuring.session import MICROSECONDS, Run, Session
from client_kit.measuring.worker_client import (
    COMPILING_MINUTES,
    BrokenError,
    DeviceBrokenError,
    FailedError,
    Outcome,
    WorkerClient,
)
from slam.datasets import SequenceError, open_sequence
from slam.devices.device import Device
from wire.protocol import NO_STAGES

MOST_BLOCKS_REPEATED = 2
# The configuration, frames done, frames in total, seconds until the session ends (None: unknown).
OnFrame = Callable[[str, int, int, float | None], None]


def _nothing(*_: Any) -> None:
    """In place of an optional callback."""


def measure(
    sequence: Path,
    manifest: Manifest,
    plan: tuple[str, ...],
    device: Device,
    *,
    references: Mapping[str, Positions],
    impossible: Mapping[str, str] | None = None,
    on_run: Callable[[Run], None] = _nothing,
    keep: Callable[[Session], None] = _nothing,
    on_frame: OnFrame = _nothing,
    on_contention: Callable[[], None] = _nothing,
    rest: Callable[[float], None] = time.sleep,
    root: Path = Path("/"),
    compiling_minutes: int = COMPILING_MINUTES,
) -> Session:
    """Measure the configurations of `plan` on `device`, one after another, over the pack at `sequence`.

    An empty frame is measured first. Every configuration then runs over the protocol's warm-up frames, whose
    results are dropped: programs are compiled and clocks rise. Each run is compared with its reference
    trajectory in `references`.

    A configuration that fails on this device is recorded with its reason, even if it ends or hangs the
    measuring process, and the others go on. Its driver may compile for `compiling_minutes` without an answer.
    A block of runs (each configuration forwards and back) of which
    other programs disturbed one is measured again, at most MOST_BLOCKS_REPEATED times in a session; what it
    replaces is dropped. Those in `impossible`, with their reasons, are not tried. If the
    device is lost, the remaining runs fail with that reason, and the finished runs stay. Ctrl-C ends the
    session, which keeps its finished runs. After every finished run, `keep` is called with the session so
    far, then `on_run` with the run. All callbacks are called outside of the measured time.

    Raises CannotMeasureError when the device or the sequence cannot be used from the start, and
    KeyboardInterrupt when no run was finished.
    """
    protocol = manifest.protocol
    try:
        frames = len(open_sequence(sequence))
    except SequenceError as error:
        raise CannotMeasureError(str(error)) from error
    if frames < protocol.frames:
        raise CannotMeasureError(
            f"the sequence has {frames} frames, the protocol measures {protocol.frames}: "
            "the server's manifest is wrong"
        )
    started_at = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
    session_id = str(uuid.uuid4())
    runs: list[Run] = []
    interrupted, blocks_repeated = False, 0

    def preparing(what: str, done: int, total: int) -> None:
        on_frame(what, done, total, None)

    with WorkerClient(
        manifest.application, sequence, device.label, device.backend, preparing, compiling_minutes
    ) as worker:
        runner = SessionRunner(worker, manifest, plan, references, impossible or {}, on_frame, root)

        def session() -> Session:
            return Session(
                session_id,
                started_at,
                device.backend,
                tuple(runs),
                tuple(runner.sampler.samples),
                empty_frame_us,
                runner.stage_clock,
                interrupted,
                blocks_repeated,
                device.threads,
                device.kind == "cpu",
            )

        try:
            empty_frame_us = runner.empty_frame_us()
            runner.warm_up()
            runner.schedule.add(plan, protocol.frames)
            for order, name in enumerate(plan):
                if runs:
                    rest(protocol.rest_seconds)
                runs.append(runner.run(name, plan[:order].count(name), order))
                keep(session())
                on_run(runs[-1])
            while blocks_repeated < MOST_BLOCKS_REPEATED and (block := _disturbed_block(session(), protocol)):
                on_contention()
                runner.schedule.add([run.configuration for run in block], protocol.frames)
                again: list[Run] = []
                for order, run in enumerate(block, start=max(run.order for run in runs) + 1):
                    rest(protocol.rest_seconds)
                    again.append(runner.run(run.configuration, run.repeat, order))
                    on_run(again[-1])
                runs[:] = [run for run in runs if run not in block] + again
                blocks_repeated += 1
                keep(session())
        except KeyboardInterrupt:
            if not runs:
                raise
            interrupted = True
        return session()


def _disturbed_block(session: Session, protocol: Protocol) -> list[Run]:
    """The first block of the runs of `session` that other programs disturbed; empty without one."""
    disturbed = {run.id for run in session.contended(protocol)}
    size = 2 * len({run.configuration for run in session.runs})
    blocks = [session.runs[start : start + size] for start in range(0, len(session.runs), size)]
    return next((list(block) for block in blocks if any(run.id in disturbed for run in block)), [])


class SessionRunner:
    """Runs a session's configurations with a worker. Between frames it shows progress and samples sensors."""

    def __init__(
        self,
        worker: WorkerClient,
        manifest: Manifest,
        plan: tuple[str, ...],
        references: Mapping[str, Positions],
        impossible: Mapping[str, str],
        on_frame: OnFrame,
        root: Path,
    ) -> None:
        self.sampler = Sampler(root)
        self.schedule = Schedule(manifest.protocol.rest_seconds)
        self.stage_clock = NO_STAGES  # until a report names their clock
        self._worker, self._manifest, self._plan, self._on_frame = worker, manifest, plan, on_frame
        self._references = references
        self._hopeless = dict(impossible)  # configurations that are not tried again, with the reasons
        self._warm: set[str] = set()

    def empty_frame_us(self) -> float:
        """The cost of an empty frame.

        If the process breaks, it is measured once more in another process. Raises CannotMeasureError if that
        fails, too.
        """
        try:
            try:
                seconds = self._worker.empty_frame_seconds()
            except (BrokenError, DeviceBrokenError) as error:
                if error.silent:
                    raise
                seconds = self._worker.empty_frame_seconds()
        except FailedError as error:
            raise CannotMeasureError(f"nothing can be measured here: {error}") from error
        return seconds * MICROSECONDS

    def warm_up(self) -> None:
        """Run each configuration over the warm-up frames; one that fails will not be tried again."""
        names = [name for name in dict.fromkeys(self._plan) if name not in self._hopeless]
        self.schedule.add(names, self._manifest.protocol.warmup_frames)
        for name in names:
            try:
                self._warm_up(name)
            except FailedError as error:
                self._hopeless[name] = str(error)
            finally:
                self.schedule.end()

    def run(self, name: str, repeat: int, order: int) -> Run:
        """Measure one configuration, its run `repeat` and run `order` of the session."""
        frames = self._manifest.protocol.frames
        try:
            if name not in self._warm:  # the process with its warm-up is gone
                self._warm_up(name)
            outcome: Outcome | str = self._over(name, frames, self._label(name, order))
        except FailedError as error:
            outcome = str(error)
        except CannotMeasureError as error:
            if not order:
                raise
            outcome = self._nothing_runs(reasons.public_line(str(error)))
        finally:
            self.schedule.end()
        if isinstance(outcome, Outcome):
            self.stage_clock = outcome.report["stage_clock"]
        configuration = self._manifest.by_name[name]
        return recorded(configuration, repeat, order, outcome, self._references[name])

    def _label(self, name: str, order: int) -> str:
        planned = len(self._plan)
        return f"{name}, run {order + 1} of {planned}" if order < planned else f"{name}, measured again"

    def _warm_up(self, name: str) -> None:
        frames = self._manifest.protocol.warmup_frames
        if frames:
            self._over(name, frames, f"warm-up, {name}")
        self._warm.add(name)

    def _over(self, name: str, frames: int, label: str) -> Outcome:
        def between_frames(done: int, total: int) -> None:
            self.sampler.sample()
            self._on_frame(label, done, total, self.schedule.left(done))

        if name in self._hopeless:
            raise FailedError(self._hopeless[name])
        self.schedule.begin()
        try:
            first = min(self._manifest.protocol.first_counted_frame, frames)
            parameters = self._manifest.by_name[name].parameters
            return self._worker.measure(parameters, frames, first, between_frames)
        except BrokenError as error:
            self._hopeless[name] = str(error)
            self._warm.clear()
            raise
        except DeviceBrokenError as error:
            self._nothing_runs(str(error))
            raise

    def _nothing_runs(self, reason: str) -> str:
        """Record and return the `reason` why no configuration is tried any more."""
        self._hopeless = dict.fromkeys(self._manifest.by_name, reason) | self._hopeless
        return reason
