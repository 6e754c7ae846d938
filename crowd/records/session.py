"""Runs measured one after another on one device, and the speedups that follow from them."""

from datetime import datetime
from typing import Annotated
from uuid import UUID

from crowd.records import shared
from crowd.records.device import Device
from crowd.records.record import Record
from wire.meaning import means, shows
from wire.session_statistics import wide_range


class SessionSpeedup(Record, frozen=True, kw_only=True):
    """A session's speedup of one configuration: None without a valid pair of runs.

    low and high are None for one pair.
    """

    configuration: shared.Configuration
    baseline: shared.Baseline
    speedup: Annotated[float | None, means("times faster than the baseline: exp(log_ratio)", "ratio")]
    low: Annotated[float | None, means("lower end of the 95 % interval of speedup over its pairs", "ratio")]
    high: Annotated[float | None, means("upper end of the same", "ratio")]
    clock: Annotated[str, means("wall, or processor: other programs ran, and processor times are compared")]
    pairs: Annotated[int, means("number of pairs of runs that it is computed from", arrow="int32")]
    drift: Annotated[float | None, means("later over earlier repeats: the farthest from 1", "ratio")]
    ate_max: Annotated[float | None, means("largest ATE among the configuration's runs", "m")]
    state: shared.State
    reason: shared.Reason

    @property
    def range(self) -> tuple[float, float] | None:
        """What is shown in place of the speedup: its interval, if that is wide."""
        return wide_range(self.low, self.high)


class Summary(SessionSpeedup, frozen=True, kw_only=True):
    """A session's speedup as a row of the open data."""

    session: Annotated[UUID, means("a row of sessions")]
    front: shared.Front
    log_ratio: Annotated[
        float | None, means("mean of the paired natural log ratios; empty without a valid pair", "log ratio")
    ]
    runs: Annotated[int, means("runs of the configuration, in any state", arrow="int32")]
    failed: Annotated[int, means("of these, how many did not finish", arrow="int32")]
    lost: Annotated[int, means("of these, how many lost the camera", arrow="int32")]
    algorithm: shared.Algorithm


class SessionRow(Record, frozen=True, kw_only=True):
    """A session in a list. `speedups` is empty until the session is `summarised`."""

    uuid: Annotated[
        UUID, means("its id, which never changes; /sessions/ID/ is its page", json="id", column="session")
    ]
    device: Annotated[Device, shows(json={"device": "slug"}, column={"device": "slug"})]
    application: shared.Application
    front: shared.Front
    protocol_version: Annotated[int, means("version of the measuring protocol", arrow="int32")]
    backend: shared.Backend
    processor: shared.Processor
    processor_class: shared.ProcessorClass
    empty_frame_us: Annotated[float | None, means("time of an empty frame on the backend", "µs")] = None
    stage_clock: Annotated[str | None, means("clock of the stage times: device, wall or none")] = None
    threads: Annotated[
        int | None,
        means("threads that computed with WebAssembly; null for other backends", arrow="int32"),
    ] = None
    blocks_repeated: Annotated[
        int | None,
        means("blocks of runs measured again because of other programs; null where unknown", arrow="int32"),
    ] = None
    started_at: Annotated[datetime, means("when it began by the device's clock, to the hour (UTC)")]
    received_at: Annotated[datetime, means("when the server received it, to the hour (UTC)")]
    summarised: Annotated[bool, means("whether its speedups are computed", column=None)]
    speedups: tuple[SessionSpeedup, ...] = ()

    @property
    def empty_frame_seconds(self) -> float | None:
        """The time of an empty frame, seconds."""
        return None if self.empty_frame_us is None else self.empty_frame_us * 1e-6

    def speedup(self, configuration: str = "best") -> SessionSpeedup | None:
        """The speedup of `configuration`, None if the session has none."""
        return next((row for row in self.speedups if row.configuration == configuration), None)


class SessionFile(SessionRow, frozen=True, kw_only=True):
    """A session as a row of the open data."""

    installation: Annotated[str, means("pseudonym of the installation, valid only within this export")]
    network_group: Annotated[
        int | None,
        means(
            "the same for installations that enrolled from one network, within one device and front of this "
            "export; empty where unknown, and for a single installation of a masked device"
        ),
    ]
    driver: Annotated[str, means("driver or browser, with its version")]
    app_version: Annotated[str, means("version of the program that measured")]
    consent_version: Annotated[
        int, means("version of the text that the participant agreed to", arrow="int32")
    ]
    samples: Annotated[
        list[dict[str, float | None]],
        means(
            "state of the device at most once a second: t (s from the start), temperature_c (°C), "
            "cpu_mhz (MHz), battery (0 to 1); null where the platform hides it",
            arrow="list<sample>",
        ),
    ]
