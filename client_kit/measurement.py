"""One measuring session: a warm-up, then every configuration over the sequence in the protocol's order."""

import hashlib
import math
import time
import uuid
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from client_kit import __version__
from client_kit.errors import CannotMeasureError
from client_kit.manifest import Manifest, Protocol
from client_kit.sensors import Sample, Sampler
from slam import benchmark, opencl
from slam.benchmark import Report
from slam.datasets.sequence import Sequence, SequenceError
from slam.opencl import NoDeviceError
from slam.system import STAGES
from slam.systems import open_session

SCHEMA_VERSION = 1
LONGEST_FAILURE = 300
MICROSECONDS = 1e6

OnFrame = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Run:
    """One configuration over the sequence. Times in microseconds, a value a frame; errors in metres.

    `repeat` counts the runs of this configuration in the session, `order` all runs, both from 0. A failed
    run has its reason in `failure` and neither times nor errors.
    """

    id: str
    configuration: str
    repeat: int
    order: int
    status: str
    failure: str | None = None
    frame_us: tuple[int, ...] = ()
    stages_us: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    tracked: tuple[bool | None, ...] = ()
    ate_max: float | None = None
    ate_mean: float | None = None
    ate_rmse: float | None = None
    trajectory_sha256: str | None = None

    def mean_seconds(self, protocol: Protocol) -> float:
        """The run's value: the arithmetic mean over the frames that count.

        Not the median: a configuration that integrates every 24th frame pays for it in few frames.
        """
        return float(np.mean(self.frame_us[protocol.first_counted_frame :])) / MICROSECONDS

    def valid(self, protocol: Protocol) -> bool:
        """Whether its speed counts: it ran, and its trajectory stayed within the limit."""
        return self.status == "ok" and self.ate_max is not None and self.ate_max < protocol.max_ate


@dataclass(frozen=True)
class Session:
    """The runs of one session on one device, with what the device said of its state meanwhile."""

    id: str
    started_at: str
    backend: str
    runs: tuple[Run, ...]
    samples: tuple[Sample, ...]

    def of(self, configuration: str) -> list[Run]:
        """The runs of one configuration, in order."""
        return [run for run in self.runs if run.configuration == configuration]

    def speedup(self, configuration: str, protocol: Protocol, baseline: str = "default") -> float | None:
        """How many times faster than the baseline: exp of the mean of the paired log ratios.

        The first run of one is paired with the first of the other, the second with the second; with the
        order default, best, best, default a steady drift cancels. None without a pair of valid runs.
        """
        ratios = [
            math.log(base.mean_seconds(protocol) / run.mean_seconds(protocol))
            for base, run in zip(self.of(baseline), self.of(configuration), strict=False)
            if base.valid(protocol) and run.valid(protocol)
        ]
        return math.exp(sum(ratios) / len(ratios)) if ratios else None


def measure(
    sequence: Sequence,
    manifest: Manifest,
    plan: tuple[str, ...],
    *,
    device: str | None = None,
    on_run: Callable[[Run], None] | None = None,
    on_frame: OnFrame | None = None,
    rest: Callable[[float], None] = time.sleep,
    root: Path = Path("/"),
) -> Session:
    """Measure the configurations of `plan`, one after another, in this process.

    Every configuration first runs over the protocol's warm-up frames, whose results are dropped: programs
    get compiled and clocks rise. A configuration that fails on this device is recorded with its reason and
    the others go on. `on_frame` hears of (what runs, frames done, frames in all), `on_run` of every
    finished run; neither is called within the measured time of a frame.

    Raises CannotMeasureError when no device can compute, or the sequence cannot serve.
    """
    protocol = manifest.protocol
    if len(sequence) < protocol.frames:
        raise CannotMeasureError(
            f"the sequence has {len(sequence)} frames, the protocol measures {protocol.frames}: "
            "the server's manifest is wrong"
        )
    started_at = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
    sampler = Sampler(root)
    try:
        opened = open_session(manifest.application, opencl.choose_device(device))
    except NoDeviceError as error:
        raise CannotMeasureError(str(error)) from error

    def attempt(name: str, frames: int, label: str) -> Report | str:
        nonlocal opened

        def between_frames(done: int, total: int) -> None:
            sampler.sample()
            if on_frame is not None:
                on_frame(label, done, total)

        parameters = manifest.configurations[name].parameters
        try:
            return benchmark.run(
                parameters,
                sequence,
                system=manifest.application,
                frames=frames,
                device=opened,
                progress=between_frames,
            )
        except SequenceError as error:
            raise CannotMeasureError(str(error)) from error
        except Exception as error:  # whatever a driver raises says something of this configuration here
            opened = open_session(
                manifest.application, opened.device
            )  # an error may leave the driver's context unusable
            return _failure(error)

    failures: dict[str, str] = {}
    if protocol.warmup_frames:
        for name in dict.fromkeys(plan):
            outcome = attempt(name, protocol.warmup_frames, f"warm-up, {name}")
            if isinstance(outcome, str):
                failures[name] = outcome
    runs: list[Run] = []
    backend = "opencl"
    for order, name in enumerate(plan):
        if order:
            rest(protocol.rest_seconds)
        repeat = sum(run.configuration == name for run in runs)
        result = failures.get(name) or attempt(
            name, protocol.frames, f"run {order + 1} of {len(plan)}, {name}"
        )
        run = _recorded(str(uuid.uuid4()), name, repeat, order, result)
        if isinstance(result, Report):
            backend = result.to_dict()["device"]["backend"]
        runs.append(run)
        if on_run is not None:
            on_run(run)
    return Session(str(uuid.uuid4()), started_at, backend, tuple(runs), tuple(sampler.samples))


def payload(session: Session, manifest: Manifest, device: Mapping[str, str | None]) -> dict[str, Any]:
    """The body of POST /submissions for one session."""
    return {
        "schema_version": SCHEMA_VERSION,
        "app_version": __version__,
        "consent_version": manifest.consent_version,
        "device": dict(device),
        "sessions": [
            {
                "id": session.id,
                "started_at": session.started_at,
                "application": manifest.application,
                "front_version": manifest.front_version,
                "protocol_version": manifest.protocol.version,
                "backend": session.backend,
                "samples": [dict(sample) for sample in session.samples],
                "runs": [_document(run) for run in session.runs],
            }
        ],
    }


def _recorded(run_id: str, configuration: str, repeat: int, order: int, result: Report | str) -> Run:
    """The run that a report, or the reason why there is none, makes."""
    if isinstance(result, str):
        return Run(run_id, configuration, repeat, order, "failed", failure=result)
    report = result.to_dict()
    frames, ate = report["frames"], report["ate"] or {}
    errors = [ate.get(name) for name in ("max", "mean", "rmse")]
    if not all(error is None or math.isfinite(error) for error in errors):
        return Run(run_id, configuration, repeat, order, "failed", failure="the trajectory is not finite")
    return Run(
        run_id,
        configuration,
        repeat,
        order,
        "ok",
        frame_us=tuple(round(frame["computation"] * MICROSECONDS) for frame in frames),
        # Rounded down, so that the stages never add up to more than the frame.
        stages_us={
            stage: tuple(math.floor(frame[stage] * MICROSECONDS) for frame in frames) for stage in STAGES
        },
        tracked=tuple(frame["tracked"] for frame in frames),
        ate_max=errors[0],
        ate_mean=errors[1],
        ate_rmse=errors[2],
        trajectory_sha256=hashlib.sha256(np.ascontiguousarray(result.poses, "<f8").tobytes()).hexdigest(),
    )


def _document(run: Run) -> dict[str, Any]:
    return {
        "id": run.id,
        "configuration": run.configuration,
        "repeat": run.repeat,
        "order": run.order,
        "status": run.status,
        "failure": run.failure,
        "frame_us": list(run.frame_us),
        "stages_us": {stage: list(series) for stage, series in run.stages_us.items()},
        "tracked": list(run.tracked),
        "ate_max": run.ate_max,
        "ate_mean": run.ate_mean,
        "ate_rmse": run.ate_rmse,
        "trajectory_sha256": run.trajectory_sha256,
    }


def _failure(error: Exception) -> str:
    """The reason in a line, without the user's folder, which often is the user's name."""
    text = f"{type(error).__name__}: {error}".replace(str(Path.home()), "~")
    return " ".join(text.split())[:LONGEST_FAILURE]
