"""Rows that reads of results return: frozen, in seconds and metres, and without data about participants.

Times of day are rounded down to the hour, so that a row cannot be matched with a person's day.
"""

import math
from dataclasses import dataclass, field
from datetime import datetime
from uuid import UUID

import numpy as np
from numpy.typing import NDArray

from crowd.devices.disclosure import PublicDevice
from crowd.devices.naming.vendors import vendor
from crowd.fronts.selectors import BEST
from crowd.results.uncertainty import Estimate, figure_estimate


@dataclass(frozen=True)
class Device(PublicDevice):
    """A device model as the public sees it, with its parts ("" if unknown)."""

    @property
    def title(self) -> str:
        return f"{self.manufacturer} {self.name}".strip()

    @property
    def vendor(self) -> str:
        """The family of its graphics chip, one of crowd.devices.naming.vendors.VENDORS."""
        return vendor("", self.gpu)


@dataclass(frozen=True)
class Speedup:
    """The speedup of a configuration over the baseline on one device model, backend and chip.

    low, high: 95 % interval over units, None below three units. repeat_low, repeat_high: repeatability on the
    only installation, None below three sessions. session_low, session_high: interval of the only session.
    confirmed: a quorum of independent networks agrees. suspect: all sessions are suspect. unit_logs: the
    packed units, never shown.
    """

    device: Device
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
    repeat_low: float | None
    repeat_high: float | None
    deviation: float | None
    units: int
    sessions: int
    installations: int
    ate_max: float | None  # m
    last_session_at: datetime
    suspect: bool
    confirmed: bool
    unit_logs: bytes = field(default=b"", repr=False)

    @property
    def vendor(self) -> str:
        """The family of the chip that computed, one of crowd.devices.naming.vendors.VENDORS."""
        return vendor(self.processor, self.device.gpu, self.processor_class)

    @property
    def state(self) -> str:
        """confirmed or unconfirmed."""
        return "confirmed" if self.confirmed else "unconfirmed"

    @property
    def estimate(self) -> Estimate:
        """Its logarithm with its uncertainty."""
        return figure_estimate(
            math.log(self.speedup), self.deviation, self.units, self.session_low, self.session_high
        )

    @property
    def counts(self) -> bool:
        """Whether it counts in the headline, rankings and cards."""
        return self.confirmed and not self.suspect

    @property
    def key(self) -> str:
        """Identifies this figure among all."""
        parts = (self.front, self.configuration, self.device.slug, self.backend, self.processor)
        return "|".join((*parts, self.processor_class))


@dataclass(frozen=True)
class CohortOutcome:
    """Failures of a configuration in one cohort: one device model, backend and chip.

    `sessions` ran it; in `failed` and `lost` of them a run failed or lost the camera. The same of the known
    networks that they come from.
    """

    device: Device
    configuration: str
    backend: str
    processor: str
    processor_class: str
    sessions: int
    failed: int
    lost: int
    networks: int
    networks_failed: int
    networks_lost: int

    @property
    def vendor(self) -> str:
        """The family of the chip that computed, one of crowd.devices.naming.vendors.VENDORS."""
        return vendor(self.processor, self.device.gpu, self.processor_class)


@dataclass(frozen=True)
class ModelOutcomes:
    """How many device models ran a configuration, and how many fail or lose the camera with it.

    A model counts if a quorum of independent networks ran the configuration. It fails, or loses the camera,
    if at least half of them report that.
    """

    devices: int
    failing: int
    losing: int


@dataclass(frozen=True)
class Headline:
    """The mean speedup over the device models with a confirmed figure; None without any.

    `low` and `high` bound the mean of these models with 95 % confidence, None below three models of few
    installations. `all_low` and `all_high` bound the mean of all models that might be measured, None for a
    small sample. `mean` is the geometric mean, in which a model far from all others counts like the nearest
    (`statistics.within_reach`), and models of few `networks` count by these (`figures.networks`), as in
    `geometric_mean` and `median`. `min` and `max` are those of the models. `unconfirmed`: the number of
    other models, which do not count here. For ALL configurations, it is about `best`.
    """

    devices: int
    sessions: int
    mean: float | None
    low: float | None
    high: float | None
    all_low: float | None
    all_high: float | None
    geometric_mean: float | None
    median: float | None
    min: float | None
    max: float | None
    unconfirmed: int
    networks: int = 0


@dataclass(frozen=True)
class BreakdownRow:
    """A row of a breakdown: the headline of the devices in `group` ("" if unknown)."""

    group: str
    figure: Headline


@dataclass(frozen=True)
class Ranking:
    """The rank of a device among the device models in the headline.

    `rank` 1 has the largest speedup; equal speedups share the better rank. `slower`: the share (0 to 1) of
    the other models with a smaller speedup, None without others. `models`: all models with their speedups,
    fastest first.
    """

    device: Device
    speedup: float
    rank: int
    slower: float | None
    models: tuple[tuple[Device, float], ...]


@dataclass(frozen=True)
class Release:
    """The speedup with one driver and version of the operating system. Times are to the hour.

    low and high are the 95 % interval over installations, None below three.
    """

    driver: str
    os_version: str
    speedup: float
    low: float | None
    high: float | None
    sessions: int
    installations: int
    first_at: datetime
    last_at: datetime


@dataclass(frozen=True)
class History:
    """A configuration's speedup on one device by driver and operating system, oldest first."""

    front: str
    configuration: str
    backend: str
    processor: str
    releases: tuple[Release, ...]


@dataclass(frozen=True)
class DeviceRow:
    """A device in a list. `speedup` is that of `best` on the newest measured front, None without one.

    With several backends and processors, it is that of the preferred one.
    """

    device: Device
    sessions: int
    installations: int
    last_session_at: datetime | None
    speedup: Speedup | None


@dataclass(frozen=True)
class SessionSpeedup:
    """A session's speedup of one configuration.

    speedup is None without a valid pair of runs. low and high (95 %, over its pairs) are None for one pair.
    """

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


@dataclass(frozen=True)
class RunRow:
    """A run without its series. Times in seconds, errors and the deviation in metres.

    `cpu_us` and `waited_us`: microseconds of the counted frames, as sent.
    """

    uuid: UUID
    configuration: str
    repeat: int
    order: int
    status: str
    failure: str
    mean_seconds: float | None
    tracked_frames: int | None
    ate_max: float | None
    ate_mean: float | None
    ate_rmse: float | None
    state: str
    reason: str
    deviation: float | None = None
    cpu_us: int | None = None
    waited_us: int | None = None

    @property
    def finished(self) -> bool:
        """Whether it did not fail. A failed run may have all frames: it lost the camera in most of them."""
        return self.status == "ok"


@dataclass(frozen=True)
class RunSeries:
    """A run with its frames: seconds (n,), seconds (n,) by stage, tracked by frame (empty if unknown)."""

    run: RunRow
    frame_seconds: NDArray[np.float64]
    stage_seconds: dict[str, NDArray[np.float64]]
    tracked: tuple[bool | None, ...]


@dataclass(frozen=True)
class SessionRow:
    """A session in a list. `speedups` is empty until the session is `summarised`.

    `empty_frame_us`: the time of an empty frame. `stage_clock`: the clock of the stage times.
    """

    uuid: UUID
    device: Device
    application: str
    front: str
    protocol_version: int
    backend: str
    processor: str
    processor_class: str
    started_at: datetime
    received_at: datetime
    summarised: bool
    speedups: tuple[SessionSpeedup, ...]
    empty_frame_us: float | None = None
    stage_clock: str | None = None
    blocks_repeated: int | None = None

    @property
    def empty_frame_seconds(self) -> float | None:
        return None if self.empty_frame_us is None else self.empty_frame_us * 1e-6

    def speedup(self, configuration: str = BEST) -> SessionSpeedup | None:
        """The speedup of CONFIGURATION, None if the session has none."""
        return next((row for row in self.speedups if row.configuration == configuration), None)


@dataclass(frozen=True)
class ListedRun:
    """A run in a list of runs of many sessions, with columns of its session.

    Times are microseconds, errors and the deviation metres.
    """

    uuid: UUID
    session: UUID
    device: Device
    application: str
    front: str
    configuration: str
    backend: str
    processor: str
    processor_class: str
    started_at: datetime
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


@dataclass(frozen=True)
class SessionDetail:
    """A session with all its runs and samples, and without data about the participant."""

    session: SessionRow
    protocol: dict[str, object]
    driver: str
    samples: list[dict[str, object]]
    runs: tuple[RunSeries, ...]


@dataclass(frozen=True)
class DeviceDetail:
    """A device with the speedups of all configurations and its newest sessions."""

    device: Device
    speedups: tuple[Speedup, ...]
    sessions: tuple[SessionRow, ...]
    session_count: int
    installations: int
    latest: SessionDetail | None = field(repr=False)


@dataclass(frozen=True)
class RunDetail:
    """A run with its frames, its session and its configuration's parameters."""

    run: RunSeries
    session: SessionRow
    protocol: dict[str, object]
    driver: str
    parameters: dict[str, object]


@dataclass(frozen=True)
class SubmissionRow:
    """The state of a submission, for the installation that sent it."""

    id: UUID
    received_at: datetime
    items: list[dict[str, object]]
    sessions: tuple[SessionRow, ...]

    @property
    def device(self) -> str | None:
        """The slug of its device; None if no session was stored."""
        return self.sessions[0].device.slug if self.sessions else None

    @property
    def summarised(self) -> bool:
        """Whether all its sessions are summarised."""
        return all(session.summarised for session in self.sessions)
