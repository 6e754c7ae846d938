"""What reads of results answer: frozen rows, in seconds and metres, with nothing in them of who measured.

Times of day are rounded down to the hour, so that a row cannot be matched with a person's day.
"""

from dataclasses import dataclass, field
from datetime import datetime
from uuid import UUID

import numpy as np
from numpy.typing import NDArray

from crowd.devices.disclosure import PublicDevice
from crowd.devices.naming.normalisation import SIMULATED
from crowd.devices.naming.vendors import vendor
from crowd.fronts.selectors import BEST


@dataclass(frozen=True)
class Device(PublicDevice):
    """A device model as the public sees it, with what is known of its parts ("" where nothing is)."""

    @property
    def title(self) -> str:
        return f"{self.manufacturer} {self.name}".strip()

    @property
    def simulated(self) -> bool:
        """Whether the device does not exist and its figures are made up."""
        return self.kind == SIMULATED

    @property
    def vendor(self) -> str:
        """The family of its graphics chip, one of crowd.devices.naming.vendors.VENDORS."""
        return vendor("", self.gpu)


@dataclass(frozen=True)
class Speedup:
    """One bar: a configuration against the baseline on one device model, backend and chip.

    low and high are the 95 % interval over units, None below three of them; repeat_low and repeat_high the
    repeatability on the only installation there is, None below three sessions; session_low and session_high
    the own interval of the only session there is. confirmed: a quorum of independent networks agrees.
    suspect: there are only suspect sessions.
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

    @property
    def vendor(self) -> str:
        """The family of the chip that computed, one of crowd.devices.naming.vendors.VENDORS."""
        return vendor(self.processor, self.device.gpu, self.processor_class)

    @property
    def state(self) -> str:
        """confirmed or unconfirmed."""
        return "confirmed" if self.confirmed else "unconfirmed"

    @property
    def counts(self) -> bool:
        """Whether headline, ranking and cards rest on it."""
        return self.confirmed and not self.suspect

    @property
    def key(self) -> str:
        """What tells this bar from every other."""
        parts = (self.front, self.configuration, self.device.slug, self.backend, self.processor)
        return "|".join((*parts, self.processor_class))


@dataclass(frozen=True)
class Attempt:
    """How one configuration fared in the `sessions` of one device model, backend and chip that ran it: in how
    many of these a run failed, or lost the camera; the same of the known networks that they come from.
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
class Attempts:
    """How one configuration fared on the device models that ran it, besides the times of those that count.

    A model is counted once a quorum of independent networks ran it. It is failing, or losing the camera,
    where at least half of them report so. Of simulated models sessions are counted instead of networks.
    """

    devices: int
    failing: int
    losing: int


@dataclass(frozen=True)
class Headline:
    """The crowd in one line, over device models with a confirmed figure: None where there are none.

    The mean is a random-effects mean that knows each figure's own uncertainty; low and high are its 95 %
    interval, None below three models. `unconfirmed`: how many other models there are, in no figure of this
    line. Where ALL configurations are shown, the line is about the best one.
    """

    devices: int
    sessions: int
    geometric_mean: float | None
    low: float | None
    high: float | None
    min: float | None
    max: float | None
    unconfirmed: int


@dataclass(frozen=True)
class Share:
    """A part of the crowd: the devices whose chip, system or maker is `group` ("" where it was not told)."""

    group: str
    figure: Headline


@dataclass(frozen=True)
class Place:
    """Where a device stands among all device models that count in the headline, itself included.

    `rank` 1 gains most, and equals share the better rank; `slower` is the share (0 to 1) of the other models
    that gain less, None where there is no other. `models`: every model with its speedup, fastest first.
    """

    device: Device
    speedup: float
    rank: int
    slower: float | None
    models: tuple[tuple[Device, float], ...]


@dataclass(frozen=True)
class Release:
    """One driver and version of the system on a device, with the speedup measured there; times to the hour.

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
    """How a configuration's speedup on one device changed with its driver and system; first seen first."""

    front: str
    configuration: str
    backend: str
    processor: str
    releases: tuple[Release, ...]


@dataclass(frozen=True)
class DeviceRow:
    """A device in the list; speedup is that of `best` on the newest measured front, None before
    any; of several backends and processors the one that counts.
    """

    device: Device
    sessions: int
    installations: int
    last_session_at: datetime | None
    speedup: Speedup | None


@dataclass(frozen=True)
class SessionSpeedup:
    """One session's answer for one configuration; speedup is None where no pair of runs was valid, low and
    high (95 %, over its pairs) are None where there is one pair alone.
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
    """A run without its series. Times in seconds, errors and the deviation (protocol 2) in metres."""

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


@dataclass(frozen=True)
class RunSeries:
    """A run with its frames: seconds (n,), stage -> seconds (n,), tracked per frame (empty if not told)."""

    run: RunRow
    frame_seconds: NDArray[np.float64]
    stage_seconds: dict[str, NDArray[np.float64]]
    tracked: tuple[bool | None, ...]


@dataclass(frozen=True)
class SessionRow:
    """A session in a list; `speedups` is empty until its task has run (`summarised`).

    Protocol 2: what an empty frame costs, and `stage_clock`, what took the times of the stages.
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

    @property
    def empty_frame_seconds(self) -> float | None:
        return None if self.empty_frame_us is None else self.empty_frame_us * 1e-6

    def speedup(self, configuration: str = BEST) -> SessionSpeedup | None:
        """The answer for CONFIGURATION, None if the session has none."""
        return next((row for row in self.speedups if row.configuration == configuration), None)


@dataclass(frozen=True)
class ListedRun:
    """A run in a list of runs of many sessions, with what its session tells. Times in microseconds, errors
    and the deviation (protocol 2) in metres.
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
    state: str
    reason: str


@dataclass(frozen=True)
class SessionDetail:
    """A session with everything that was measured in it. Public: says nothing of who measured."""

    session: SessionRow
    protocol: dict[str, object]
    driver: str
    samples: list[dict[str, object]]
    runs: tuple[RunSeries, ...]


@dataclass(frozen=True)
class DeviceDetail:
    """One device's page: its speedups of every configuration, its newest sessions."""

    device: Device
    speedups: tuple[Speedup, ...]
    sessions: tuple[SessionRow, ...]
    session_count: int
    installations: int
    latest: SessionDetail | None = field(repr=False)


@dataclass(frozen=True)
class RunDetail:
    """One run's page: its frames, its session, and what happened around it."""

    run: RunSeries
    session: SessionRow
    protocol: dict[str, object]
    driver: str
    parameters: dict[str, object]


@dataclass(frozen=True)
class SubmissionRow:
    """What became of a submission, for the installation that sent it."""

    id: UUID
    received_at: datetime
    items: list[dict[str, object]]
    sessions: tuple[SessionRow, ...]

    @property
    def device(self) -> str | None:
        """Slug of the device it was measured on; None where no session was stored."""
        return self.sessions[0].device.slug if self.sessions else None

    @property
    def summarised(self) -> bool:
        """Whether every session of it has been worked through."""
        return all(session.summarised for session in self.sessions)
