"""Whether the configuration that is fastest on the reference device is the fastest on others, too."""

from collections import Counter
from statistics import median

import numpy as np

from crowd.fronts.selectors import fastest_on_reference
from crowd.records.device import Device
from crowd.results.reading.queries.filters import SpeedupFilters
from crowd.results.reading.transferring.rows import Winner, Winners
from crowd.results.reading.transferring.tables import SpeedupTable, speedup_table
from wire.front import BEST

LEAST_CONFIGURATIONS = 3
# Within this factor of the fastest, the reference's fastest nearly wins.
NEAR = 1.1


def winners(filters: SpeedupFilters) -> Winners:
    """The fastest configuration of each device with confirmed figures of LEAST_CONFIGURATIONS, by slug.

    The default is included; probes, which few devices measure, are not. One query besides those of
    `speedup_table`.
    """
    table = speedup_table(filters, LEAST_CONFIGURATIONS, probes=False)
    reference = fastest_on_reference(table.front) if table.front else BEST
    rows = tuple(_winner(table, reference, row, device) for row, device in enumerate(table.devices))
    regrets = [row.regret for row in rows if row.regret is not None]
    counts = Counter(row.winner for row in rows)
    return Winners(
        filters=filters,
        front=table.front,
        reference=reference,
        rows=rows,
        counts=tuple(sorted(counts.items(), key=lambda item: (-item[1], item[0]))),
        judged=len(regrets),
        wins=sum(row.reference_rank == 1 for row in rows),
        median_regret=median(regrets) if regrets else None,
        nearly_wins=sum(regret <= NEAR for regret in regrets) / len(regrets) if regrets else None,
        unconfirmed=table.unconfirmed,
    )


def _winner(table: SpeedupTable, reference: str, row: int, device: Device) -> Winner:
    logs = table.log_speedups[row]
    first = int(np.nanargmax(logs))
    column = table.configurations.index(reference) if reference in table.configurations else None
    log = None if column is None or np.isnan(logs[column]) else float(logs[column])
    return Winner(
        device=device,
        backend=table.backends[row],
        processor=table.processors[row],
        configurations=int(np.isfinite(logs).sum()),
        winner=table.configurations[first],
        speedup=float(np.exp(logs[first])),
        reference_speedup=None if log is None else float(np.exp(log)),
        reference_rank=None if log is None else 1 + int((logs > log).sum()),
        regret=None if log is None else float(np.exp(logs[first] - log)),
        sessions=table.sessions[row],
    )
