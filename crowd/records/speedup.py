"""The published figure: the speedup of a configuration on a device model."""

import math
from datetime import datetime
from typing import Annotated

from crowd.records import shared
from crowd.records.device import Device
from crowd.records.record import Record
from crowd.records.uncertainty import Estimate, figure_estimate
from wire.meaning import means, shows
from wire.session_statistics import wide_range


class Speedup(Record, frozen=True, kw_only=True):
    """The speedup of a configuration over the baseline on one device model, backend and chip.

    low, high: None below three units. `confirmed`: a quorum of independent networks agrees. unit_logs: the
    packed units, never shown. skipped: the share of frames that the configuration left out on the reference,
    None if it computes all.
    """

    device: Annotated[
        Device,
        shows(
            json={
                "device": "slug",
                **{
                    name: name for name in ("manufacturer", "name", "soc", "gpu", "os", "simulated", "masked")
                },
            },
            column={"device": "slug"},
        ),
    ]
    vendor: Annotated[str, means("family of the chip that computed", column=None)]
    front: shared.Front
    configuration: shared.Configuration
    baseline: shared.Baseline
    backend: shared.Backend
    processor: shared.Processor
    processor_class: shared.ProcessorClass
    speedup: Annotated[float, means("times faster: robust mean of independent installations' means", "ratio")]
    low: Annotated[
        float | None,
        means("lower end of the 95 % interval over independent installations, from 3 on", "ratio"),
    ]
    high: Annotated[float | None, means("upper end of the same", "ratio")]
    session_low: Annotated[float | None, means("lower end of the 95 % interval of its only session", "ratio")]
    session_high: Annotated[float | None, means("upper end of the same", "ratio")]
    repeat_low: Annotated[
        float | None,
        means("lower end: repeatability on its only installation, from 3 sessions on", "ratio", json=None),
    ]
    repeat_high: Annotated[float | None, means("upper end of the same", "ratio", json=None)]
    sessions: Annotated[int, means("sessions that count")]
    installations: Annotated[int, means("installations that count")]
    witnesses: Annotated[int, means("independent installations that agree with it", json=None)]
    confirmed: Annotated[bool, means("whether they reach the quorum of this server", json=None)]
    ate_max: Annotated[float | None, means("largest ATE of the configuration among those sessions", "m")]
    validity: Annotated[
        str,
        means("valid, or suspect: only suspect sessions stand behind it", json=None, column="state"),
    ]
    algorithm: shared.Algorithm
    last_session_at: Annotated[datetime, means("start of the newest session that counts, to the hour (UTC)")]
    deviation: float | None
    units: int
    skipped: float | None = None
    unit_logs: bytes = b""

    @property
    def state(self) -> Annotated[str, means("confirmed or unconfirmed", column=None)]:
        """confirmed or unconfirmed."""
        return "confirmed" if self.confirmed else "unconfirmed"

    @property
    def suspect(self) -> Annotated[bool, means("whether only suspect sessions stand behind it", column=None)]:
        """Whether only suspect sessions stand behind it."""
        return self.validity == "suspect"

    @property
    def log_ratio(self) -> Annotated[float, means("natural logarithm of speedup", "log ratio", json=None)]:
        """The natural logarithm of the speedup."""
        return math.log(self.speedup)

    @property
    def standard_error(
        self,
    ) -> Annotated[float, means("of log_ratio; the guide has its formula", "log ratio", json=None)]:
        """The standard error of log_ratio."""
        return self.estimate.error

    @property
    def estimate(self) -> Estimate:
        """Its logarithm with its uncertainty."""
        return figure_estimate(
            self.log_ratio, self.deviation, self.units, self.session_low, self.session_high
        )

    @property
    def counts(self) -> bool:
        """Whether it counts in the headline, rankings and cards."""
        return self.confirmed and not self.suspect

    @property
    def range(self) -> tuple[float, float] | None:
        """What is shown in place of the speedup: the interval of its only session, if that is wide."""
        return wide_range(self.session_low, self.session_high) if self.low is None else None

    @property
    def key(self) -> str:
        """Identifies this figure among all."""
        parts = (self.front, self.configuration, self.device.slug, self.backend, self.processor)
        return "|".join((*parts, self.processor_class))
