"""Whether the reference device's best configuration is the fastest on other devices."""

from collections import Counter
from statistics import median

import numpy as np

from crowd.fronts.selectors import BEST
from crowd.records.device import Device
from crowd.results.reading.queries.filters import SpeedupFilters
from crowd.results.reading.transferring.rows import Winner, Winners
from crowd.results.reading.transferring.tables import SpeedupTable, speedup_table

LEAST_CONFIGURATIONS = 3
# Within this factor of the fastest, the reference's best nearly wins.
NEAR = 1.1


def winners(filters: SpeedupFilters) -> Winners:
    """The fastest configuration of each device with confirmed figures of LEAST_CONFIGURATIONS, by slug.

    The default is included; probes, which few devices measure, are not. No queries besides those of
    `speedup_table`.
    """
    table = speedup_table(filters, LEAST_CONFIGURATIONS, probes=False)
    rows = tuple(_winner(table, row, device) for row, device in enumerate(table.devices))
    regrets = [row.regret for row in rows if row.regret is not None]
    counts = Counter(row.winner for row in rows)
    return Winners(
        filters=filters,
        front=table.front,
        reference=BEST,
        rows=rows,
        counts=tuple(sorted(counts.items(), key=lambda item: (-item[1], item[0]))),
        judged=len(regrets),
        wins=sum(row.best_rank == 1 for row in rows),
        median_regret=median(regrets) if regrets else None,
        nearly_wins=sum(regret <= NEAR for regret in regrets) / len(regrets) if regrets else None,
        unconfirmed=table.unconfirmed,
    )


def _winner(table: SpeedupTable, row: int, device: Device) -> Winner:
    logs = table.log_speedups[row]
    first = int(np.nanargmax(logs))
    best = table.configurations.index(BEST) if BEST in table.configurations else None
    best_log = None if best is None or np.isnan(logs[best]) else float(logs[best])
    return Winner(
        device=device,
        backend=table.backends[row],
        processor=table.processors[row],
        configurations=int(np.isfinite(logs).sum()),
        winner=table.configurations[first],
        speedup=float(np.exp(logs[first])),
        best_speedup=None if best_log is None else float(np.exp(best_log)),
        best_rank=None if best_log is None else 1 + int((logs > best_log).sum()),
        regret=None if best_log is None else float(np.exp(logs[first] - best_log)),
        sessions=table.sessions[row],
    )
