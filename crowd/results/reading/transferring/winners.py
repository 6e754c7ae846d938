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
    found = speedup_table(filters, LEAST_CONFIGURATIONS, probes=False)
    rows = tuple(_winner(found, place, device) for place, device in enumerate(found.devices))
    regrets = [row.regret for row in rows if row.regret is not None]
    counts = Counter(row.winner for row in rows)
    return Winners(
        filters=filters,
        front=found.front,
        reference=BEST,
        rows=rows,
        counts=tuple(sorted(counts.items(), key=lambda item: (-item[1], item[0]))),
        judged=len(regrets),
        wins=sum(row.best_rank == 1 for row in rows),
        median_regret=median(regrets) if regrets else None,
        nearly_wins=sum(regret <= NEAR for regret in regrets) / len(regrets) if regrets else None,
        unconfirmed=found.unconfirmed,
    )


def _winner(found: SpeedupTable, place: int, device: Device) -> Winner:
    logs = found.log_speedups[place]
    first = int(np.nanargmax(logs))
    best = found.configurations.index(BEST) if BEST in found.configurations else None
    own = None if best is None or np.isnan(logs[best]) else float(logs[best])
    return Winner(
        device=device,
        backend=found.backends[place],
        processor=found.processors[place],
        configurations=int(np.isfinite(logs).sum()),
        winner=found.configurations[first],
        speedup=float(np.exp(logs[first])),
        best_speedup=None if own is None else float(np.exp(own)),
        best_rank=None if own is None else 1 + int((logs > own).sum()),
        regret=None if own is None else float(np.exp(logs[first] - own)),
        sessions=found.sessions[place],
    )
