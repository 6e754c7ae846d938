"""Checks of recommendations against later measurements, and the maps behind them."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp
from statistics import median

from crowd.predictions import recommendations, selectors
from crowd.predictions.models import DeviceMap
from crowd.records.device import Device
from crowd.results.public_rows import read_devices


@dataclass(frozen=True)
class Judgement:
    """A recommendation and the later measurement, as ratios to the default.

    `regret`: its time over that of the fastest measured point. `best_regret`: the same for the published
    best, None if it was not measured.
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
    """All judgements of a front, largest regret first; medians and worst values are None without any."""

    rows: tuple[Judgement, ...]

    @property
    def within(self) -> int:
        """The number of measurements within the predicted intervals."""
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
    """The maps of a front. A device counts once per backend and chip.

    `recommended`: devices with a recommendation. `others`: those with another one than the published best;
    None if unknown.
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


def judgements(front: str) -> Judgements:
    """The recommendations of `front` (slug) that were measured later, with public devices."""
    judged = recommendations.judged_recommendations(front)
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


def maps_of(front: str) -> Maps:
    """The maps of `front` (slug), most devices first."""
    return Maps(selectors.maps_of(front))


def _median(values: Sequence[float]) -> float | None:
    return median(values) if values else None
