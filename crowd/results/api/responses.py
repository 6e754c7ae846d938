"""Schemas of the responses about figures, devices and submissions."""

from datetime import datetime
from uuid import UUID

import msgspec

from crowd.records.device import Device
from crowd.records.measured_device import DeviceRow
from crowd.records.record import answer, fill
from crowd.records.session import SessionRow
from crowd.records.speedup import Speedup
from crowd.results.api.session_responses import SessionAnswer, session
from crowd.results.figures.dry_run import Judgement
from crowd.results.models import State
from crowd.results.reading.rows import Headline, MeanSpeedup, ModelOutcomes, SubmissionRow
from crowd.results.reading.transferring.rows import DeviceCorrelation

HEADLINE_METHOD = (
    "geometric mean over models; one farther than a factor of 10 from all others counts like the nearest; "
    "what models of few networks add is limited"
)


class Enrolled(msgspec.Struct):
    """A new installation. The token is shown only once."""

    installation_id: UUID
    token: str


class Item(msgspec.Struct):
    """The result of one run: accepted, duplicate, or rejected with code, member and remedy."""

    id: str | None
    status: str
    code: str | None
    field: str | None = None
    detail: str | None = None


class Accepted(msgspec.Struct):
    """The result of a submission, with an item for each run in the order sent."""

    submission_id: UUID
    items: list[Item]


class JudgedConfiguration(msgspec.Struct):
    """The state of a configuration in a session, and the code and the sentence of the rule that applies."""

    session: UUID
    configuration: str
    state: str
    reason: str
    meaning: str


class Checked(msgspec.Struct):
    """The result of a dry run. Nothing was stored.

    `judged`: what the accepted runs say of each configuration, by the rules that need no other session.
    """

    items: list[Item]
    judged: list[JudgedConfiguration]


class SubmissionState(msgspec.Struct):
    """The state of a submission.

    `summarised`: all its sessions are summarised. `device`: slug of the public device. `page`: path of the
    participant's private page, which names the device and is only shown here.
    """

    submission_id: UUID
    received_at: datetime
    items: list[Item]
    device: str | None
    page: str
    summarised: bool
    sessions: list[SessionAnswer]


class SpeedupAnswer(answer(Speedup)):  # type: ignore[misc]
    """The speedup of a configuration over the baseline on one device.

    `state`: confirmed, if enough independent installations agree, else unconfirmed.
    """


class HeadlineAnswer(answer(MeanSpeedup)):  # type: ignore[misc]
    """The mean speedup over the device models with a confirmed figure; null without any.

    low and high are the 95 % interval for the mean of the models measured, all_low and all_high for the mean
    of all models that might be measured: null for fewer than 29.
    """

    method: str


class Crowd(msgspec.Struct):
    """The speedups of the device models with a confirmed figure.

    `headline` is the figure on pages. `geometric_mean`, `min` and `max` are of the `devices` models as they
    are. `unconfirmed`: the number of other measured models. Of all models `attempted` from a quorum of
    networks, `failing` did not finish, and `losing` lost the camera, on at least half of these networks.
    """

    devices: int
    sessions: int
    headline: HeadlineAnswer
    geometric_mean: float | None
    min: float | None
    max: float | None
    unconfirmed: int
    attempted: int
    failing: int
    losing: int


class SpeedupPage(msgspec.Struct):
    """Speedups, fastest first. The summary is over all pages."""

    front: str | None
    results: list[SpeedupAnswer]
    next: str | None
    summary: Crowd


class DeviceAnswer(answer(DeviceRow)):  # type: ignore[misc]
    """A device model in the list of devices.

    `speedup` is that of the requested application. `sessions`, `installations` and `last_session_at` are over
    all applications.
    """

    speedup: float | None


class DevicePage(msgspec.Struct):
    """Devices, fastest first."""

    results: list[DeviceAnswer]
    next: str | None


class DeviceDetailAnswer(answer(Device)):  # type: ignore[misc]
    """A device model with the speedups of all configurations and its newest sessions.

    `session_count` and `installations` are over all applications.
    """

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
    """The correlations of two devices over the configurations of a front that both measured.

    Pearson of log times, Spearman of ranks.
    """

    devices: list[str]
    front: str
    configurations: int
    pearson: Coefficient
    spearman: Coefficient


class Comparison(msgspec.Struct):
    """Devices in the requested order. A pair with too few common configurations has no correlation."""

    results: list[DeviceDetailAnswer]
    correlations: list[Correlated]


def speedup(row: Speedup) -> SpeedupAnswer:
    """A speedup as JSON."""
    return fill(SpeedupAnswer, row)


def crowd(row: Headline, outcomes: ModelOutcomes) -> Crowd:
    """The headline as JSON, with the models that failed or lost the camera."""
    return Crowd(
        devices=row.devices,
        sessions=row.sessions,
        headline=fill(HeadlineAnswer, row, method=HEADLINE_METHOD),
        geometric_mean=row.geometric_mean,
        min=row.min,
        max=row.max,
        unconfirmed=row.unconfirmed,
        attempted=outcomes.devices,
        failing=outcomes.failing,
        losing=outcomes.losing,
    )


def device(row: DeviceRow) -> DeviceAnswer:
    """A device in a list as JSON."""
    return fill(DeviceAnswer, row, speedup=row.speedup.speedup if row.speedup else None)


def device_detail(
    device: Device,
    session_count: int,
    installations: int,
    speedups: tuple[Speedup, ...],
    sessions: tuple[SessionRow, ...],
) -> DeviceDetailAnswer:
    """A device with its speedups and sessions as JSON."""
    return fill(
        DeviceDetailAnswer,
        device,
        session_count=session_count,
        installations=installations,
        speedups=[speedup(row) for row in speedups],
        sessions=[session(row) for row in sessions],
    )


def correlated(row: DeviceCorrelation) -> Correlated:
    """A correlation as JSON."""
    return msgspec.convert(row, Correlated, from_attributes=True)


def judged(judgements: list[Judgement]) -> list[JudgedConfiguration]:
    """The states of configurations as JSON."""
    return [
        JudgedConfiguration(session, configuration, rule.state, rule.code, rule.words)
        if rule
        else JudgedConfiguration(session, configuration, State.VALID, "", "")
        for session, configuration, rule in judgements
    ]


def submission(row: SubmissionRow, page: str) -> SubmissionState:
    """The state of a submission as JSON, with the path of the participant's private `page`."""
    return SubmissionState(
        submission_id=row.id,
        received_at=row.received_at,
        items=msgspec.convert(row.items, list[Item]),
        device=row.device,
        page=page,
        summarised=row.summarised,
        sessions=[session(each) for each in row.sessions],
    )
