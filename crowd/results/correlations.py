"""How alike two devices rank and scale the configurations that both measured."""

import math
from collections.abc import Iterable, Sequence
from itertools import combinations

from crowd.results.models import DeviceSpeedup, State
from crowd.results.rows import DeviceCorrelation
from pareto.correlation import correlate

Logs = dict[str, float]


def between(slugs: Sequence[str]) -> tuple[DeviceCorrelation, ...]:
    """Pearson and Spearman of each two of the devices called SLUGS, in their order, with 95 % intervals.

    Of the newest front of which both have valid figures of enough configurations; pairs without such a front
    are left out. Pearson is that of logarithms of time: a speedup is a ratio over the default, so log times
    differ from negated log speedups by a constant only, and the default itself is one more common
    configuration, at 0. A device measured on several processors stands by the one with the most sessions.
    One query.
    """
    tables = _tables(slugs)
    found = (_pair(first, second, tables) for first, second in combinations(dict.fromkeys(slugs), 2))
    return tuple(row for row in found if row is not None)


def _tables(slugs: Iterable[str]) -> dict[str, dict[str, Logs]]:
    """Negated log speedups by device, front (newest first) and configuration."""
    rows = (
        DeviceSpeedup.objects.filter(device__slug__in=slugs, state=State.VALID)
        .order_by("-front__published_at", "-sessions", "processor")
        .values_list(
            "device__slug",
            "front__slug",
            "backend",
            "processor",
            "configuration__name",
            "baseline__name",
            "speedup",
        )
    )
    tables: dict[str, dict[str, Logs]] = {}
    chosen: dict[tuple[str, str], tuple[str, str]] = {}
    for device, front, backend, processor, configuration, baseline, speedup in rows:
        # The first row of a device and front is of the processor with the most sessions.
        if chosen.setdefault((device, front), (backend, processor)) == (backend, processor):
            table = tables.setdefault(device, {}).setdefault(front, {baseline: 0.0})
            table[configuration] = -math.log(speedup)
    return tables


def _pair(first: str, second: str, tables: dict[str, dict[str, Logs]]) -> DeviceCorrelation | None:
    for front, one in tables.get(first, {}).items():
        other = tables.get(second, {}).get(front, {})
        common = sorted(one.keys() & other.keys())
        found = correlate([one[name] for name in common], [other[name] for name in common])
        if found is not None:
            return DeviceCorrelation(first, second, front, found.count, found.pearson, found.spearman)
    return None
