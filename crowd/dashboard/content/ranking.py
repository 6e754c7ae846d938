"""The ranking of a front's configurations on one device."""

from dataclasses import dataclass

from crowd.records.speedup import Speedup
from crowd.results.reading.rows import DeviceDetail
from wire.front import BEST, DEFAULT


@dataclass(frozen=True)
class ConfigurationRanking:
    """The figures of one front, backend and processor on a device, fastest first.

    `configurations`: the number with a valid figure, including the default. `winner`: the fastest of them;
    `winner_range`: the wide interval that is shown in place of its speedup.
    `best_rank`: the rank of `best`; equal ones share the better rank; None without a valid figure. `regret`:
    the time of `best` over that of the winner. `confirmed`: all valid figures are confirmed.
    """

    rows: tuple[Speedup, ...]
    configurations: int
    winner: str
    winner_speedup: float
    winner_range: tuple[float, float] | None
    best_rank: int | None
    regret: float | None
    confirmed: bool


def rank_configurations(detail: DeviceDetail, lead: Speedup | None) -> ConfigurationRanking | None:
    """The configurations of `detail` with the front, backend and processor of `lead`; None without `lead`."""
    if lead is None:
        return None
    rows = [row for row in detail.speedups if _measured_as(row) == _measured_as(lead)]
    valid = {row.configuration: row.speedup for row in rows if not row.suspect} | {DEFAULT: 1.0}
    winner = min(valid, key=lambda name: (-valid[name], name))
    best = valid.get(BEST)
    return ConfigurationRanking(
        rows=tuple(sorted(rows, key=lambda row: (-row.speedup, row.configuration))),
        configurations=len(valid),
        winner=winner,
        winner_speedup=valid[winner],
        winner_range=next((row.range for row in rows if row.configuration == winner), None),
        best_rank=None if best is None else 1 + sum(speedup > best for speedup in valid.values()),
        regret=None if best is None else valid[winner] / best,
        confirmed=all(row.confirmed for row in rows if not row.suspect),
    )


def _measured_as(row: Speedup) -> tuple[str, str, str, str]:
    return row.front, row.backend, row.processor, row.processor_class
