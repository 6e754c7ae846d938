"""Rows that reads of transfer return: winning configurations, and correlations of devices."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from crowd.records.device import Device
from crowd.results.reading.queries.filters import SpeedupFilters
from pareto.devices.correlation import Estimate


@dataclass(frozen=True)
class Winner:
    """The fastest configuration of a front on one device, compared with that of the reference device.

    `configurations`: how many were measured, default included. `speedup`: that of `winner` over the default.
    reference_speedup and reference_rank are those of the reference's fastest (equals share the better rank).
    `regret`: how many times slower than the winner it is, 1 or more. All three are None if it has no valid
    figure. As the winner is chosen by measured time, noise alone gives a regret above 1.
    """

    device: Device
    backend: str
    processor: str
    configurations: int
    winner: str
    speedup: float
    reference_speedup: float | None
    reference_rank: int | None
    regret: float | None
    sessions: int


@dataclass(frozen=True)
class Winners:
    """The winner of a front (None: no front) on each device under `filters` with enough configurations.

    `counts`: the number of devices by winner, most first. `judged` devices measured `reference`, the fastest
    on the reference device: it is the fastest on `wins` of them, and within a tenth of the fastest on the
    share nearly_wins. nearly_wins and median_regret are None if `judged` is 0. All figures are confirmed.
    `unconfirmed`: other devices that measured enough configurations, with too few confirmed figures.
    """

    filters: SpeedupFilters
    front: str | None
    reference: str
    rows: tuple[Winner, ...]
    counts: tuple[tuple[str, int], ...]
    judged: int
    wins: int
    median_regret: float | None
    nearly_wins: float | None
    unconfirmed: int


@dataclass(frozen=True)
class CorrelationMatrix:
    """The correlations of devices under `filters` over one front's configurations, (devices, devices).

    `pearson` of log times and `spearman` of ranks, over the `common` configurations that both measured,
    default included. NaN on the diagonal, for too few configurations, and if one device runs all equally
    fast. `left_out`: the number of devices that are not shown, as they have fewer sessions. `unconfirmed`: as
    in Winners.
    """

    filters: SpeedupFilters
    front: str | None
    devices: tuple[Device, ...]
    sessions: tuple[int, ...]
    pearson: NDArray[np.float64]
    spearman: NDArray[np.float64]
    common: NDArray[np.int64]
    left_out: int
    unconfirmed: int


@dataclass(frozen=True)
class DeviceCorrelation:
    """The correlations of the times of two devices (slugs) over the configurations that both measured.

    `configurations` of one front. Pearson of log times, Spearman of ranks, each with a 95 % interval.
    """

    devices: tuple[str, str]
    front: str
    configurations: int
    pearson: Estimate
    spearman: Estimate
