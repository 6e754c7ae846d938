"""One measuring session: a warm-up, then every configuration over the sequence in the protocol's order.

What other programs disturbed is measured again at the end.
"""

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from msgspec.structs import replace

from client_kit.delivery.manifest import Manifest, Protocol
from client_kit.delivery.reference_trajectories import Positions
from client_kit.device.sensors import Sampler
from client_kit.errors import CannotMeasureError
from client_kit.measuring import reasons
from client_kit.measuring.run_record import recorded
from client_kit.measuring.schedule import Schedule
from client_kit.measuring.session import MICROSECONDS, Run, Session, begin
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

MOST_BLOCKS_REPEATED = 2


@dataclass(frozen=True)
class Task:
    """What a session measures: the configurations of `plan`, one after another, over the pack at `sequence`.

    Each run is compared with its reference trajectory in `references`. Configurations in `impossible`, with
    their reasons, are not tried.
    """

    asked: Manifest
    plan: tuple[str, ...]
    sequence: Path
    references: Mapping[str, Positions]
    impossible: Mapping[str, str] = field(default_factory=dict)

    def require_frames(self) -> None:
        """Raises CannotMeasureError when the sequence cannot be read or is too short."""
        try:
            frames = len(open_sequence(self.sequence))
        except SequenceError as error:
            raise CannotMeasureError(str(error)) from error
        if frames < self.asked.protocol.frames:
            raise CannotMeasureError(
                f"the sequence has {frames} frames, the protocol measures {self.asked.protocol.frames}: "
                "the server's manifest is wrong"
            )


class Observer:
    """Follows a session; each method is called outside of the measured time. This one shows nothing."""

    def frame(self, label: str, done: int, total: int, left: float | None) -> None:
        """A step of what `label` names is done; `left`: seconds until the session ends, None if unknown."""

    def run(self, run: Run) -> None:
        """A run has finished."""

    def session(self, session: Session) -> None:
        """A run or a repeated block has finished: the session so far, which must not be lost."""

    def contention(self) -> None:
        """Other programs disturbed a block of runs: it is measured again."""

    def rest(self, seconds: float) -> None:
        """Wait before the next run."""
        time.sleep(seconds)


def measure(
    task: Task,
    device: Device,
    observer: Observer,
    root: Path = Path("/"),
    compiling_minutes: int = COMPILING_MINUTES,
) -> tuple[Session, bool]:
    """Measure `task` on `device`; the session, and whether Ctrl-C ended it after its finished runs.

    An empty frame is measured first. Every configuration then runs over the protocol's warm-up frames, whose
    results are dropped: programs are compiled and clocks rise.

    A configuration that fails on this device is recorded with its reason, even if it ends or hangs the
    measuring process, and the others go on. Its driver may compile for `compiling_minutes` without an answer.
    A block of runs (each configuration forwards and back) of which other programs disturbed one is measured
    again, at most MOST_BLOCKS_REPEATED times in a session; what it replaces is dropped. If the device is
    lost, the remaining runs fail with that reason, and the finished runs stay.

    Raises CannotMeasureError when the device or the sequence cannot be used from the start, and
    KeyboardInterrupt when no run was finished.
    """
    task.require_frames()
    with WorkerClient(
        task.asked.application,
        task.sequence,
        device.label,
        device.backend,
        lambda what, done, total: observer.frame(what, done, total, None),
        compiling_minutes,
    ) as worker:
        return SessionRunner(task, worker, device, observer, root).measure()


def _disturbed_block(session: Session, protocol: Protocol) -> tuple[Run, ...]:
    """The first block of the runs of `session` that other programs disturbed; empty without one."""
    disturbed = {run.id for run in session.contended(protocol)}
    size = 2 * len({run.configuration for run in session.runs})
    blocks = [session.runs[start : start + size] for start in range(0, len(session.runs), size)]
    return next((block for block in blocks if any(run.id in disturbed for run in block)), ())


class SessionRunner:
    """Runs a session's configurations with a worker. Between frames it shows progress and samples sensors."""

    def __init__(
        self, task: Task, worker: WorkerClient, device: Device, observer: Observer, root: Path
    ) -> None:
        self._task, self._worker, self._observer = task, worker, observer
        self._protocol = task.asked.protocol
        self._sampler = Sampler(root)
        self._schedule = Schedule(self._protocol.rest_seconds)
        self._hopeless = dict(task.impossible)  # configurations that are not tried again, with the reasons
        self._warm: set[str] = set()
        begun = begin(task.asked, device.backend, device.threads, device.kind == "cpu")
        self._session = replace(begun, samples=self._sampler.samples)

    def measure(self) -> tuple[Session, bool]:
        """Measure the session, as the function `measure`."""
        try:
            self._update(empty_frame_us=self._empty_frame_us())
            self._warm_up_all()
            self._measure_plan()
            self._measure_disturbed_again()
        except KeyboardInterrupt:
            if not self._session.runs:
                raise
            return self._session, True
        return self._session, False

    def _update(self, **members: Any) -> None:
        self._session = replace(self._session, **members)

    def _measure_plan(self) -> None:
        plan = self._task.plan
        self._schedule.add(plan, self._protocol.frames)
        for order, name in enumerate(plan):
            if order:
                self._observer.rest(self._protocol.rest_seconds)
            run = self._run(name, plan[:order].count(name), order)
            self._update(runs=(*self._session.runs, run))
            self._observer.session(self._session)
            self._observer.run(run)

    def _measure_disturbed_again(self) -> None:
        for repeated in range(1, MOST_BLOCKS_REPEATED + 1):
            runs = self._session.runs
            block = _disturbed_block(self._session, self._protocol)
            if not block:
                return
            self._observer.contention()
            self._schedule.add([run.configuration for run in block], self._protocol.frames)
            again: list[Run] = []
            for order, run in enumerate(block, start=max(run.order for run in runs) + 1):
                self._observer.rest(self._protocol.rest_seconds)
                again.append(self._run(run.configuration, run.repeat, order))
                self._observer.run(again[-1])
            self._update(runs=(*(run for run in runs if run not in block), *again), blocks_repeated=repeated)
            self._observer.session(self._session)

    def _empty_frame_us(self) -> float:
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

    def _warm_up_all(self) -> None:
        """Run each configuration over the warm-up frames; one that fails will not be tried again."""
        names = [name for name in dict.fromkeys(self._task.plan) if name not in self._hopeless]
        self._schedule.add(names, self._protocol.warmup_frames)
        for name in names:
            try:
                self._warm_up(name)
            except FailedError as error:
                self._hopeless[name] = str(error)
            finally:
                self._schedule.end()

    def _run(self, name: str, repeat: int, order: int) -> Run:
        """Measure one configuration, its run `repeat` and run `order` of the session."""
        frames = self._protocol.frames
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
            self._schedule.end()
        if isinstance(outcome, Outcome):
            self._update(stage_clock=outcome.report["stage_clock"])
        return recorded(name, repeat, order, outcome, self._task.references[name])

    def _label(self, name: str, order: int) -> str:
        planned = len(self._task.plan)
        return f"{name}, run {order + 1} of {planned}" if order < planned else f"{name}, measured again"

    def _warm_up(self, name: str) -> None:
        frames = self._protocol.warmup_frames
        if frames:
            self._over(name, frames, f"warm-up, {name}")
        self._warm.add(name)

    def _over(self, name: str, frames: int, label: str) -> Outcome:
        def between_frames(done: int, total: int) -> None:
            self._sampler.sample()
            self._observer.frame(label, done, total, self._schedule.left(done))

        if name in self._hopeless:
            raise FailedError(self._hopeless[name])
        self._schedule.begin()
        try:
            first = min(self._protocol.first_counted_frame, frames)
            parameters = self._task.asked.by_name[name].parameters
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
        self._hopeless = dict.fromkeys(self._task.asked.by_name, reason) | self._hopeless
        return reason
