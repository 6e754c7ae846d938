"""How a front's configurations rank on one device: which one wins there, and where `best` comes in."""

from dataclasses import dataclass

from crowd.fronts.selectors import BEST, DEFAULT
from crowd.results.reading.rows import DeviceDetail, Speedup


@dataclass(frozen=True)
class Standing:
    """The figures of one front, backend and processor on a device, fastest first.

    Of `configurations` with a valid figure, the default among them, `winner` is the fastest; best_rank is 1
    where that is `best` (equals share the better rank) and None where `best` has no valid figure. regret: how
    many times the winner's time `best` takes. `confirmed`: all of the valid figures are.
    """

    rows: tuple[Speedup, ...]
    configurations: int
    winner: str
    winner_speedup: float
    best_rank: int | None
    regret: float | None
    confirmed: bool


def standing(detail: DeviceDetail, lead: Speedup | None) -> Standing | None:
    """The configurations of DETAIL that were measured as LEAD was; None without LEAD."""
    if lead is None:
        return None
    rows = [row for row in detail.speedups if _measured_as(row) == _measured_as(lead)]
    valid = {row.configuration: row.speedup for row in rows if not row.suspect} | {DEFAULT: 1.0}
    winner = min(valid, key=lambda name: (-valid[name], name))
    best = valid.get(BEST)
    return Standing(
        rows=tuple(sorted(rows, key=lambda row: (-row.speedup, row.configuration))),
        configurations=len(valid),
        winner=winner,
        winner_speedup=valid[winner],
        best_rank=None if best is None else 1 + sum(speedup > best for speedup in valid.values()),
        regret=None if best is None else valid[winner] / best,
        confirmed=all(row.confirmed for row in rows if not row.suspect),
    )


def _measured_as(row: Speedup) -> tuple[str, str, str, str]:
    return row.front, row.backend, row.processor, row.processor_class
