"""Rows that reads of results return: frozen, in seconds and metres, and without data about participants.

Times of day are rounded down to the hour, so that a row cannot be matched with a person's day.
"""

from dataclasses import dataclass, field
from datetime import datetime
from typing import Annotated
from uuid import UUID

import numpy as np
from numpy.typing import NDArray

from crowd.records.device import Device
from crowd.records.record import Record
from crowd.records.run import RunRow
from crowd.records.session import SessionRow
from crowd.records.speedup import Speedup
from crowd.results.figures.cohorts import OutcomeCounts
from wire.front import Protocol
from wire.meaning import means


@dataclass(frozen=True)
class CohortOutcome:
    """Failures of a configuration in one cohort: one device model, backend and chip.

    `vendor`: the family of the chip that computed, one of crowd.devices.naming.chips.VENDORS.
    """

    device: Device
    configuration: str
    backend: str
    processor: str
    vendor: str
    counts: OutcomeCounts


@dataclass(frozen=True)
class Gain:
    """How many times faster one configuration is than another on the same device.

    Geometric mean, min and max over the `devices` with confirmed figures of both.
    """

    devices: int
    mean: float
    min: float
    max: float


@dataclass(frozen=True)
class ModelOutcomes:
    """How many device models ran a configuration, and how many fail or lose the camera with it.

    A model counts if a quorum of independent networks ran the configuration. It fails, or loses the camera,
    if at least half of them report that.
    """

    devices: int
    failing: int
    losing: int


class MeanSpeedup(Record, frozen=True, kw_only=True):
    """The mean speedup over the device models with a confirmed figure; None without any.

    `low` and `high` bound the mean of these models with 95 % confidence, None below three models of few
    installations. `all_low` and `all_high` bound the mean of all models that might be measured, None for a
    small sample. `mean` is the geometric mean, in which a model far from all others counts like the nearest
    (`statistics.within_reach`), and models of few `networks` count by these (`figures.networks`), as in
    `median`.
    """

    mean: Annotated[float | None, means("the mean", json="value")] = None
    low: Annotated[float | None, means("lower end of the 95 % interval")] = None
    high: Annotated[float | None, means("upper end of the 95 % interval")] = None
    all_low: Annotated[
        float | None, means("lower end of the interval for the mean of all models that might be measured")
    ] = None
    all_high: Annotated[
        float | None, means("upper end of the interval for the mean of all models that might be measured")
    ] = None
    median: Annotated[float | None, means("median over models")] = None
    devices: Annotated[int, means("device models that count", json="models")] = 0
    networks: Annotated[int, means("known networks that measured these models")] = 0


class Headline(MeanSpeedup, frozen=True, kw_only=True):
    """The mean speedup, and what is known of the same models besides.

    `geometric_mean` is that of the models' speedups as they are; `min` and `max` are the smallest and the
    largest. `unconfirmed`: the number of other models, which do not count here. For ALL configurations, it is
    about `best`. `range`: of a single model, what is shown in place of its speedup.
    """

    sessions: int = 0
    geometric_mean: float | None = None
    min: float | None = None
    max: float | None = None
    unconfirmed: int
    range: tuple[float, float] | None = None


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
class RunSeries:
    """A run with its frames: seconds (n,), seconds (n,) by stage, tracked by frame (empty if unknown).

    `skipped`: the share of the counted frames that it left out; None if its configuration computes all.
    `first_counted`: the number of the first frame that counts.
    """

    run: RunRow
    frame_seconds: NDArray[np.float64]
    stage_seconds: dict[str, NDArray[np.float64]]
    tracked: tuple[bool | None, ...]
    skipped: float | None = None
    first_counted: int = 0

    @property
    def computed(self) -> NDArray[np.bool_]:
        """Whether each frame (n,) was computed, and not left out by the configuration.

        The first frames build the model: they are not tracked, but computed.
        """
        if self.skipped is None:
            return np.ones(self.frame_seconds.size, dtype=bool)
        tried = np.array([tracked is not None for tracked in self.tracked], dtype=bool)
        computed: NDArray[np.bool_] = tried | (np.cumsum(tried) == 0)
        return computed

    @property
    def p95_seconds(self) -> float | None:
        """95 of 100 counted frames take no longer; None without any."""
        counted = self.frame_seconds[self.first_counted :]
        return float(np.quantile(counted, 0.95)) if counted.size else None

    @property
    def max_seconds(self) -> float | None:
        """The largest time of a counted frame; None without any."""
        counted = self.frame_seconds[self.first_counted :]
        return float(counted.max()) if counted.size else None


@dataclass(frozen=True)
class SessionDetail:
    """A session with all its runs and samples, and without data about the participant."""

    session: SessionRow
    protocol: Protocol
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
    protocol: Protocol
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
