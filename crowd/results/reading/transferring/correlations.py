"""Correlations of two devices over the configurations that both measured."""

import math
from collections.abc import Iterable, Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from crowd.devices.disclosure import find
from crowd.records.device import Device
from crowd.results.models import DeviceSpeedup, State
from crowd.results.reading.queries.filters import SpeedupFilters
from crowd.results.reading.transferring.rows import CorrelationMatrix, DeviceCorrelation
from crowd.results.reading.transferring.tables import speedup_table
from pareto.devices.correlation import correlate

LEAST_COMMON = 3  # two points always lie on a line
MOST_DEVICES = 40  # that fit into a heat map

Array = NDArray[np.float64]
Logs = dict[str, float]


def device_correlations(slugs: Sequence[str]) -> tuple[DeviceCorrelation, ...]:
    """Pearson and Spearman correlations of all pairs of the devices `slugs`, in order, with 95 % intervals.

    For each pair, the newest front for which both have valid figures of enough configurations. Pairs without
    such a front are left out.

    Pearson is that of log times. They differ from negated log speedups only by a constant, and the default is
    a further common configuration, at 0. With several processors, that with the most sessions counts. At most
    two queries for each device and one more.
    """
    tables = _tables(slugs)
    pairs = (_pair(first, second, tables) for first, second in combinations(dict.fromkeys(slugs), 2))
    return tuple(row for row in pairs if row is not None)


def correlation_matrix(filters: SpeedupFilters, most: int = MOST_DEVICES) -> CorrelationMatrix:
    """The correlations of the `most` devices with the most sessions under `filters`, by vendor, then by name.

    They measured at least LEAST_COMMON configurations. The configuration of `filters` is ignored. No queries
    besides those of `speedup_table`.
    """
    table = speedup_table(filters, LEAST_COMMON)
    popular = sorted(
        range(len(table.devices)), key=lambda row: (-table.sessions[row], table.devices[row].slug)
    )[:most]
    shown = sorted(popular, key=lambda row: _order(table.devices[row]))
    pearson, spearman, common = pairwise(-table.log_speedups[shown])
    return CorrelationMatrix(
        filters=filters,
        front=table.front,
        devices=tuple(table.devices[row] for row in shown),
        sessions=tuple(table.sessions[row] for row in shown),
        pearson=pearson,
        spearman=spearman,
        common=common,
        left_out=len(table.devices) - len(shown),
        unconfirmed=table.unconfirmed,
    )


def _order(device: Device) -> tuple[str, str, str]:
    return device.vendor, device.title, device.slug


def pairwise(values: Array) -> tuple[Array, Array, NDArray[np.int64]]:
    """Pearson, Spearman and number of common columns of all pairs of rows of `values` (n, m): three (n, n).

    `values` are NaN where not measured. Correlations are NaN on the diagonal, below LEAST_COMMON columns,
    and if a row is constant over these. Rows with the same columns are computed together: most devices
    measure either a whole front or its best.
    """
    measured = np.isfinite(values)
    common = measured.astype(np.int64) @ measured.T.astype(np.int64)
    pearson, spearman = np.full(common.shape, np.nan), np.full(common.shape, np.nan)
    patterns, members = np.unique(measured, axis=0, return_inverse=True)
    rows = [np.flatnonzero(members.ravel() == pattern) for pattern in range(len(patterns))]
    for first in range(len(patterns)):
        for second in range(first + 1):
            columns = np.flatnonzero(patterns[first] & patterns[second])
            if len(columns) < LEAST_COMMON:
                continue
            x, y = values[np.ix_(rows[first], columns)], values[np.ix_(rows[second], columns)]
            for answer, (a, b) in ((pearson, (x, y)), (spearman, (_ranks(x), _ranks(y)))):
                correlation = _normalised(a) @ _normalised(b).T
                answer[np.ix_(rows[first], rows[second])] = np.clip(correlation, -1.0, 1.0)
                answer[np.ix_(rows[second], rows[first])] = np.clip(correlation.T, -1.0, 1.0)
    for answer in (pearson, spearman):
        np.fill_diagonal(answer, np.nan)
    return pearson, spearman, common


def _normalised(values: Array) -> Array:
    """Each row minus its mean, with length 1; NaN for a constant row."""
    centred = values - values.mean(axis=1, keepdims=True)
    length = np.linalg.norm(centred, axis=1, keepdims=True)
    normalised: Array = np.divide(centred, length, out=np.full_like(centred, np.nan), where=length > 0)
    return normalised


def _ranks(values: Array) -> Array:
    """The ranks of each row; equal values share their mean rank."""
    mine, others = values[:, :, None], values[:, None, :]
    ranks: Array = (others < mine).sum(axis=2) + ((others == mine).sum(axis=2) + 1) / 2
    return ranks


def _tables(slugs: Iterable[str]) -> dict[str, dict[str, Logs]]:
    """Negated log speedups by device, front (newest first) and configuration."""
    models = {model.pk: slug for slug in slugs if (model := find(slug)) is not None}
    rows = (
        DeviceSpeedup.objects.filter(device__in=models, state=State.VALID)
        .order_by("-front__published_at", "-sessions", "processor")
        .values_list(
            "device_id",
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
    for key, front, backend, processor, configuration, baseline, speedup in rows:
        device = models[key]
        # The first row of a device and front is of the processor with the most sessions.
        if chosen.setdefault((device, front), (backend, processor)) == (backend, processor):
            table = tables.setdefault(device, {}).setdefault(front, {baseline: 0.0})
            table[configuration] = -math.log(speedup)
    return tables


def _pair(first: str, second: str, tables: dict[str, dict[str, Logs]]) -> DeviceCorrelation | None:
    for front, one in tables.get(first, {}).items():
        other = tables.get(second, {}).get(front, {})
        common = sorted(one.keys() & other.keys())
        correlation = correlate([one[name] for name in common], [other[name] for name in common])
        if correlation is not None:
            return DeviceCorrelation(
                (first, second), front, correlation.count, correlation.pearson, correlation.spearman
            )
    return None
