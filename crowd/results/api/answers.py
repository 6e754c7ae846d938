"""Shapes of the answers about results."""

from dataclasses import fields
from datetime import datetime
from typing import Any
from uuid import UUID

import msgspec
import numpy as np
from numpy.typing import NDArray

from crowd.results.reading.rows import (
    Attempts,
    Device,
    DeviceRow,
    Headline,
    ListedRun,
    RunSeries,
    SessionDetail,
    SessionRow,
    SessionSpeedup,
    Speedup,
    SubmissionRow,
)
from crowd.results.reading.transferring.transfer_rows import DeviceCorrelation


class Enrolled(msgspec.Struct):
    """A new installation; the token is shown this once."""

    installation_id: UUID
    token: str


class Item(msgspec.Struct):
    """What became of one run: accepted, duplicate or rejected with its code, member and remedy."""

    id: str | None
    status: str
    code: str | None
    field: str | None = None
    detail: str | None = None


class Accepted(msgspec.Struct):
    """What became of a submission, one item a run in the order they came."""

    submission_id: UUID
    items: list[Item]


class Checked(msgspec.Struct):
    """What would become of a submission; nothing was stored."""

    items: list[Item]


class SpeedupOfSession(msgspec.Struct):
    """One session's speedup of a configuration and its own interval; null where no pair of runs was valid."""

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
    """A session; times of day are rounded down to the hour. `summarised`: it was worked through.

    Protocol 2, else null: `empty_frame_us`, what an empty frame costs, and `stage_clock`: device, wall or
    none.
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
    started_at: datetime
    received_at: datetime
    summarised: bool
    speedups: list[SpeedupOfSession]


class SessionPage(msgspec.Struct):
    """Sessions, newest first."""

    results: list[SessionAnswer]
    next: str | None


class SampleAnswer(msgspec.Struct):
    """The state of the device `t` seconds after the start; null where the platform hides it. `battery` is 0
    to 1.
    """

    t: float
    temperature_c: float | None
    cpu_mhz: float | None
    battery: float | None


class MeasuredRun(msgspec.Struct, kw_only=True):
    """One configuration over the whole sequence. `state`: valid, suspect, invalid, quarantined, or pending
    until it is checked; `reason` says why it is not valid.

    `mean_us`: the mean over the counted frames. Errors and `deviation` (protocol 2) are metres.
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
    state: str
    reason: str


class RunAnswer(MeasuredRun, kw_only=True):
    """A run in a list of runs of many sessions; `started_at` is the session's, rounded down to the hour.

    `state`: valid, suspect, invalid, quarantined, or pending until it is checked; `reason` says why it is not
    valid. `mean_us`: the mean over the counted frames. Errors and `deviation` (protocol 2) are metres.
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
    """Runs: those of the newest session first, and of each its newest run first."""

    results: list[RunAnswer]
    next: str | None


class RunWithFrames(MeasuredRun, kw_only=True):
    """A run with its frames: the time of each, the times of its stages, and whether its tracking succeeded
    (null: not tried; empty: not known).

    `state`: valid, suspect, invalid, quarantined, or pending until it is checked; `reason` says why it is not
    valid. `mean_us`: the mean over the counted frames. Errors and `deviation` (protocol 2) are metres.
    """

    frame_us: list[int]
    stages_us: dict[str, list[int]]
    tracked: list[bool | None]


class SessionDetailAnswer(msgspec.Struct):
    """A session with everything that was measured in it; times of day are rounded down to the hour.

    `driver`: the driver, or the browser, with its version.
    """

    id: UUID
    device: str
    application: str
    front: str
    protocol_version: int
    backend: str
    processor: str
    processor_class: str
    driver: str
    empty_frame_us: float | None
    stage_clock: str | None
    started_at: datetime
    received_at: datetime
    summarised: bool
    speedups: list[SpeedupOfSession]
    samples: list[SampleAnswer]
    runs: list[RunWithFrames]


class SubmissionState(msgspec.Struct):
    """What became of a submission: `summarised` once all its sessions count, `device` the slug of what
    everybody sees, `page` the path of the participant's own page, which names the device and is told to
    nobody else.
    """

    submission_id: UUID
    received_at: datetime
    items: list[Item]
    device: str | None
    page: str
    summarised: bool
    sessions: list[SessionAnswer]


class SpeedupAnswer(msgspec.Struct):
    """How much faster a configuration runs than the baseline on one device.

    `vendor`: the family of the chip that computed, `processor_class`: cpu or gpu. `state`: confirmed, where
    enough independent installations agree, or unconfirmed. session_low and session_high: the session's own
    interval where one session stands behind the figure. `masked`: shown by its chip.
    """

    device: str
    manufacturer: str
    name: str
    soc: str
    gpu: str
    os: str
    vendor: str
    simulated: bool
    masked: bool
    front: str
    configuration: str
    baseline: str
    backend: str
    processor: str
    processor_class: str
    speedup: float
    low: float | None
    high: float | None
    session_low: float | None
    session_high: float | None
    sessions: int
    installations: int
    ate_max: float | None
    last_session_at: datetime
    state: str
    suspect: bool


class Crowd(msgspec.Struct):
    """The crowd in one line, over device models with a confirmed figure.

    low and high are the geometric mean's 95 % interval. `unconfirmed`: how many other models were measured.
    Of all `attempted` models, `failing` did not finish and `losing` lost the camera in at least half of their
    sessions.
    """

    devices: int
    sessions: int
    geometric_mean: float | None
    low: float | None
    high: float | None
    min: float | None
    max: float | None
    unconfirmed: int
    attempted: int
    failing: int
    losing: int


class SpeedupPage(msgspec.Struct):
    """Speedups, fastest first; the summary is over all pages."""

    front: str | None
    results: list[SpeedupAnswer]
    next: str | None
    summary: Crowd


class DeviceAnswer(msgspec.Struct):
    """A device model in the list of devices: `speedup` is of the application asked for, `sessions`,
    `installations` and `last_session_at` are over all applications.
    """

    slug: str
    manufacturer: str
    name: str
    cpu: str
    soc: str
    gpu: str
    os: str
    simulated: bool
    masked: bool
    sessions: int
    installations: int
    last_session_at: datetime | None
    speedup: float | None


class DevicePage(msgspec.Struct):
    """Devices, fastest first."""

    results: list[DeviceAnswer]
    next: str | None


class DeviceDetailAnswer(msgspec.Struct):
    """A device model with every configuration's speedup and its newest sessions; `session_count` and
    `installations` are over all applications.
    """

    slug: str
    manufacturer: str
    name: str
    cpu: str
    soc: str
    gpu: str
    os: str
    simulated: bool
    masked: bool
    session_count: int
    installations: int
    speedups: list[SpeedupAnswer]
    sessions: list[SessionAnswer]


class Coefficient(msgspec.Struct):
    """A correlation coefficient with its 95 % interval."""

    value: float
    low: float
    high: float


class Correlated(msgspec.Struct):
    """How alike the times of two devices are over the configurations of a front that both measured.

    Pearson is that of the logarithms of time, Spearman that of the ranks.
    """

    devices: list[str]
    front: str
    configurations: int
    pearson: Coefficient
    spearman: Coefficient


class Comparison(msgspec.Struct):
    """Devices side by side, in the order asked for; a pair with too little in common has no correlation."""

    results: list[DeviceDetailAnswer]
    correlations: list[Correlated]


def speedup(row: Speedup) -> SpeedupAnswer:
    """A bar as JSON."""
    return SpeedupAnswer(
        device=row.device.slug,
        manufacturer=row.device.manufacturer,
        name=row.device.name,
        soc=row.device.soc,
        gpu=row.device.gpu,
        os=row.device.os,
        vendor=row.vendor,
        simulated=row.device.simulated,
        masked=row.device.masked,
        front=row.front,
        configuration=row.configuration,
        baseline=row.baseline,
        backend=row.backend,
        processor=row.processor,
        processor_class=row.processor_class,
        speedup=row.speedup,
        low=row.low,
        high=row.high,
        session_low=row.session_low,
        session_high=row.session_high,
        sessions=row.sessions,
        installations=row.installations,
        ate_max=row.ate_max,
        last_session_at=row.last_session_at,
        state=row.state,
        suspect=row.suspect,
    )


def crowd(row: Headline, fared: Attempts) -> Crowd:
    """The headline as JSON, with how the configuration fared."""
    return Crowd(
        devices=row.devices,
        sessions=row.sessions,
        geometric_mean=row.geometric_mean,
        low=row.low,
        high=row.high,
        min=row.min,
        max=row.max,
        unconfirmed=row.unconfirmed,
        attempted=fared.devices,
        failing=fared.failing,
        losing=fared.losing,
    )


def device(row: DeviceRow) -> DeviceAnswer:
    """A device in a list as JSON."""
    return DeviceAnswer(
        **_device(row.device),
        sessions=row.sessions,
        installations=row.installations,
        last_session_at=row.last_session_at,
        speedup=row.speedup.speedup if row.speedup else None,
    )


def device_detail(
    device: Device,
    session_count: int,
    installations: int,
    speedups: tuple[Speedup, ...],
    sessions: tuple[SessionRow, ...],
) -> DeviceDetailAnswer:
    """A device's page as JSON."""
    return DeviceDetailAnswer(
        **_device(device),
        session_count=session_count,
        installations=installations,
        speedups=[speedup(row) for row in speedups],
        sessions=[session(row) for row in sessions],
    )


def correlated(row: DeviceCorrelation) -> Correlated:
    """A correlation as JSON."""
    return Correlated(
        devices=[row.first, row.second],
        front=row.front,
        configurations=row.configurations,
        pearson=Coefficient(row.pearson.value, row.pearson.low, row.pearson.high),
        spearman=Coefficient(row.spearman.value, row.spearman.low, row.spearman.high),
    )


def session(row: SessionRow) -> SessionAnswer:
    """A session as JSON."""
    return SessionAnswer(**_session(row))


def session_detail(row: SessionDetail) -> SessionDetailAnswer:
    """A session with everything that was measured in it as JSON."""
    return SessionDetailAnswer(
        **_session(row.session),
        driver=row.driver,
        # What else a client sent with a sample is shown to its owner alone.
        samples=[
            msgspec.convert({name: sample.get(name) for name in SampleAnswer.__struct_fields__}, SampleAnswer)
            for sample in row.samples
        ],
        runs=[_run_with_frames(run) for run in row.runs],
    )


def run(row: ListedRun) -> RunAnswer:
    """A run in a list as JSON."""
    members = {field.name: getattr(row, field.name) for field in fields(row)}
    return RunAnswer(**members | {"id": members.pop("uuid"), "device": row.device.slug})


def submission(row: SubmissionRow, page: str) -> SubmissionState:
    """A submission's state as JSON, with the path of the participant's own PAGE."""
    return SubmissionState(
        submission_id=row.id,
        received_at=row.received_at,
        items=msgspec.convert(row.items, list[Item]),
        device=row.device,
        page=page,
        summarised=row.summarised,
        sessions=[session(each) for each in row.sessions],
    )


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


def _session(row: SessionRow) -> dict[str, Any]:
    return {
        "id": row.uuid,
        "device": row.device.slug,
        "application": row.application,
        "front": row.front,
        "protocol_version": row.protocol_version,
        "backend": row.backend,
        "processor": row.processor,
        "processor_class": row.processor_class,
        "empty_frame_us": row.empty_frame_us,
        "stage_clock": row.stage_clock,
        "started_at": row.started_at,
        "received_at": row.received_at,
        "summarised": row.summarised,
        "speedups": [_session_speedup(answer) for answer in row.speedups],
    }


def _run_with_frames(row: RunSeries) -> RunWithFrames:
    one = row.run
    same = {name: getattr(one, name) for name in MeasuredRun.__struct_fields__ if hasattr(one, name)}
    return RunWithFrames(
        **same,
        id=one.uuid,
        mean_us=None if one.mean_seconds is None else one.mean_seconds * 1e6,
        frame_us=_microseconds(row.frame_seconds),
        stages_us={name: _microseconds(series) for name, series in row.stage_seconds.items()},
        tracked=list(row.tracked),
    )


def _microseconds(seconds: NDArray[np.float64]) -> list[int]:
    return [round(microseconds) for microseconds in (seconds * 1e6).tolist()]


def _device(row: Device) -> dict[str, Any]:
    return {
        "slug": row.slug,
        "manufacturer": row.manufacturer,
        "name": row.name,
        "cpu": row.cpu,
        "soc": row.soc,
        "gpu": row.gpu,
        "os": row.os,
        "simulated": row.simulated,
        "masked": row.masked,
    }
