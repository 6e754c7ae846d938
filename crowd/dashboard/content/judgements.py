"""Were the recommendations right? What devices measured since, and which model of devices predicts."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp
from statistics import median

from crowd.predictions import recommending, selectors
from crowd.predictions.models import DeviceMap
from crowd.results.reading.public_rows import read_devices
from crowd.results.reading.rows import Device


@dataclass(frozen=True)
class Judgement:
    """A recommendation beside what the device measured later: ratios to the default, how many times slower
    than the fastest point measured there it is, and the published best (None where that was not measured).
    """

    device: Device
    configuration: str
    predicted: float
    low: float
    high: float
    measured: float
    within_interval: bool
    regret: float
    best_regret: float | None


@dataclass(frozen=True)
class Judgements:
    """All of a front, largest regret first; medians and worst values are None without any."""

    rows: tuple[Judgement, ...]

    @property
    def within(self) -> int:
        """How many lay within their intervals."""
        return sum(row.within_interval for row in self.rows)

    @property
    def median_regret(self) -> float | None:
        return _median([row.regret for row in self.rows])

    @property
    def worst_regret(self) -> float | None:
        return max((row.regret for row in self.rows), default=None)

    @property
    def median_best_regret(self) -> float | None:
        return _median(self._best)

    @property
    def worst_best_regret(self) -> float | None:
        return max(self._best, default=None)

    @property
    def _best(self) -> list[float]:
        return [row.best_regret for row in self.rows if row.best_regret is not None]


@dataclass(frozen=True)
class Maps:
    """The maps of a front: `recommended` devices (a device counts once for each backend and chip) and for how
    many `others` another configuration than the published best is recommended; None where that is unknown.
    """

    rows: Sequence[DeviceMap]

    @property
    def recommended(self) -> int:
        return sum(row.devices for row in self.rows)

    @property
    def others(self) -> int | None:
        counts = [row.other_recommended for row in self.rows]
        known = [count for count in counts if count is not None]
        return sum(known) if known and len(known) == len(counts) else None


def judgements(front: str, simulated: bool) -> Judgements:
    """The recommendations of FRONT (slug) that were measured since; devices as the public sees them."""
    judged = recommending.judged(front, simulated)
    devices = read_devices(one.recommendation.device_id for one in judged)
    rows = [
        Judgement(
            device=devices[one.recommendation.device_id],
            configuration=one.recommendation.configuration.name,
            predicted=exp(one.recommendation.log_ratio),
            low=exp(one.recommendation.low),
            high=exp(one.recommendation.high),
            measured=one.ratio,
            within_interval=one.within_interval,
            regret=one.regret,
            best_regret=one.best_regret,
        )
        for one in judged
    ]
    return Judgements(tuple(sorted(rows, key=lambda row: (-row.regret, row.device.slug))))


def maps_of(front: str, simulated: bool) -> Maps:
    """The maps of FRONT (slug), those with most devices first."""
    return Maps(selectors.maps_of(front, simulated))


def _median(values: Sequence[float]) -> float | None:
    return median(values) if values else None
