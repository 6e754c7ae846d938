"""Schemas of the responses about sessions and runs."""

from datetime import datetime
from typing import Any
from uuid import UUID

import msgspec
import numpy as np
from numpy.typing import NDArray

from crowd.results.reading.rows import ListedRun, RunSeries, SessionDetail, SessionRow, SessionSpeedup


class SpeedupOfSession(msgspec.Struct):
    """A session's speedup of a configuration with its interval; null without a valid pair of runs."""

    configuration: str
    baseline: str
    speedup: float | None
    low: float | None
    high: float | None
    pairs: int
    drift: float | None
    ate_max: float | None
    state: str
    reason: str


class SessionAnswer(msgspec.Struct):
    """A session. Times of day are rounded down to the hour. `summarised`: its speedups are computed.

    `empty_frame_us`: the time of an empty frame. `stage_clock`: device, wall or none. `blocks_repeated`: how
    often runs were measured again because other programs disturbed them; null where the client did not say.
    """

    id: UUID
    device: str
    application: str
    front: str
    protocol_version: int
    backend: str
    processor: str
    processor_class: str
    empty_frame_us: float | None
    stage_clock: str | None
    blocks_repeated: int | None
    started_at: datetime
    received_at: datetime
    summarised: bool
    speedups: list[SpeedupOfSession]


class SessionPage(msgspec.Struct):
    """Sessions, newest first."""

    results: list[SessionAnswer]
    next: str | None


class SampleAnswer(msgspec.Struct):
    """The state of the device `t` seconds after the start; null if the platform hides it.

    `battery` is 0 to 1.
    """

    t: float
    temperature_c: float | None
    cpu_mhz: float | None
    battery: float | None


class MeasuredRun(msgspec.Struct, kw_only=True):
    """A run of a configuration over the sequence.

    `state`: valid, suspect, invalid, quarantined, or pending until it is checked. `reason` says why it is not
    valid.

    `mean_us`: the mean over the counted frames. Errors and `deviation` are metres. Over the counted frames:
    `cpu_us`, of the processor over all threads; `waited_us`, how long threads stood ready without one.
    """

    id: UUID
    configuration: str
    repeat: int
    order: int
    status: str
    failure: str
    mean_us: float | None
    tracked_frames: int | None
    ate_max: float | None
    ate_mean: float | None
    ate_rmse: float | None
    deviation: float | None
    cpu_us: int | None
    waited_us: int | None
    state: str
    reason: str


class RunAnswer(MeasuredRun, kw_only=True):
    """A run in a list of runs of many sessions; `started_at` is the session's, rounded down to the hour.

    `state`: valid, suspect, invalid, quarantined, or pending until it is checked; `reason` says why it is not
    valid. `mean_us`: the mean over the counted frames. Errors and `deviation` are metres.
    """

    session: UUID
    device: str
    application: str
    front: str
    backend: str
    processor: str
    processor_class: str
    started_at: datetime


class RunPage(msgspec.Struct):
    """Runs: newest session first, and in each its newest run first."""

    results: list[RunAnswer]
    next: str | None


class RunWithFrames(MeasuredRun, kw_only=True):
    """A run with its frames: times, times of the stages, and whether tracking succeeded.

    `tracked`: null for a frame without tracking; empty if unknown.

    `state`: valid, suspect, invalid, quarantined, or pending until it is checked; `reason` says why it is not
    valid. `mean_us`: the mean over the counted frames. Errors and `deviation` are metres.
    """

    frame_us: list[int]
    stages_us: dict[str, list[int]]
    tracked: list[bool | None]


class SessionDetailAnswer(SessionAnswer):
    """A session with its runs and samples. Times of day are rounded down to the hour.

    `driver`: the driver, or the browser, with its version.
    """

    driver: str
    samples: list[SampleAnswer]
    runs: list[RunWithFrames]


def session(row: SessionRow) -> SessionAnswer:
    """A session as JSON."""
    return SessionAnswer(
        id=row.uuid,
        device=row.device.slug,
        application=row.application,
        front=row.front,
        protocol_version=row.protocol_version,
        backend=row.backend,
        processor=row.processor,
        processor_class=row.processor_class,
        empty_frame_us=row.empty_frame_us,
        stage_clock=row.stage_clock,
        blocks_repeated=row.blocks_repeated,
        started_at=row.started_at,
        received_at=row.received_at,
        summarised=row.summarised,
        speedups=[_session_speedup(answer) for answer in row.speedups],
    )


def session_detail(row: SessionDetail) -> SessionDetailAnswer:
    """A session with its runs and samples as JSON."""
    return SessionDetailAnswer(
        **msgspec.structs.asdict(session(row.session)),
        driver=row.driver,
        # Unknown members of a sample are only shown to its owner.
        samples=[
            msgspec.convert({name: sample.get(name) for name in SampleAnswer.__struct_fields__}, SampleAnswer)
            for sample in row.samples
        ],
        runs=[_run_with_frames(run) for run in row.runs],
    )


def run(row: ListedRun) -> RunAnswer:
    """A run in a list as JSON."""
    return RunAnswer(**_shared_members(RunAnswer, row) | {"id": row.uuid, "device": row.device.slug})


def _session_speedup(row: SessionSpeedup) -> SpeedupOfSession:
    return SpeedupOfSession(
        configuration=row.configuration,
        baseline=row.baseline,
        speedup=row.speedup,
        low=row.low,
        high=row.high,
        pairs=row.pairs,
        drift=row.drift,
        ate_max=row.ate_max,
        state=row.state,
        reason=row.reason,
    )


def _run_with_frames(row: RunSeries) -> RunWithFrames:
    one = row.run
    return RunWithFrames(
        **_shared_members(MeasuredRun, one),
        id=one.uuid,
        mean_us=None if one.mean_seconds is None else one.mean_seconds * 1e6,
        frame_us=_microseconds(row.frame_seconds),
        stages_us={name: _microseconds(series) for name, series in row.stage_seconds.items()},
        tracked=list(row.tracked),
    )


def _microseconds(seconds: NDArray[np.float64]) -> list[int]:
    return [round(microseconds) for microseconds in (seconds * 1e6).tolist()]


def _shared_members(struct: type[msgspec.Struct], row: object) -> dict[str, Any]:
    """The attributes of ROW that are members of STRUCT."""
    return {name: getattr(row, name) for name in struct.__struct_fields__ if hasattr(row, name)}
