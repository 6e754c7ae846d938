"""What reads of transfer answer: which configuration wins where, and how alike devices are. Frozen rows."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from crowd.results.reading.queries.filters import SpeedupFilters
from crowd.results.reading.rows import Device
from pareto.devices.correlation import Estimate


@dataclass(frozen=True)
class Winner:
    """Which of a front's configurations is fastest on one device, and how the reference's best does there.

    Of `configurations` measured ones, the default among them, `winner` is `speedup` times as fast as the
    default. best_speedup and best_rank are those of the reference's best (1: it wins here too; equals share
    the better rank), and `regret` how many times slower it is than the winner, 1 or more; None where it has
    no valid figure. The winner was picked by its measured time: noise alone makes a regret above 1.
    """

    device: Device
    backend: str
    processor: str
    configurations: int
    winner: str
    speedup: float
    best_speedup: float | None
    best_rank: int | None
    regret: float | None
    sessions: int


@dataclass(frozen=True)
class Winners:
    """The winners of one front (None: no front) on each device under `filters` that measured enough
    configurations.

    `counts`: how many devices each winning configuration wins on, most first. Of the `judged` devices that
    measured the reference's best, it is the fastest on `wins`, and within a tenth of the fastest on the share
    nearly_wins; nearly_wins and median_regret are None where none measured it. All figures are confirmed;
    `unconfirmed` other devices measured enough configurations, but too few of their figures are confirmed.
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
    """How alike devices under `filters` scale and rank one front's configurations; each array is
    (devices, devices).

    `pearson` is that of logarithms of time, `spearman` that of ranks, over the `common` configurations that
    both measured, the default among them; NaN on the diagonal, where those are too few, and where one device
    runs them all equally fast. `left_out` devices with fewer sessions are not among `devices`, nor are
    the `unconfirmed` ones.
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
    """How alike two devices (slugs) are: their times over the configurations of one front that both measured.

    There are `configurations` of those. Pearson of the logarithms, Spearman of the ranks, each with its 95 %
    interval.
    """

    first: str
    second: str
    front: str
    configurations: int
    pearson: Estimate
    spearman: Estimate
