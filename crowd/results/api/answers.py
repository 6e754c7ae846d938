"""Shapes of the answers about figures, devices and submissions."""

from datetime import datetime
from typing import Any
from uuid import UUID

import msgspec

from crowd.results.api.session_answers import SessionAnswer, session
from crowd.results.reading.rows import (
    Attempts,
    Device,
    DeviceRow,
    Headline,
    SessionRow,
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
