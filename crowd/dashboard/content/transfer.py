"""Transfer of a front to other devices: winners and correlations."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from crowd.records.device import Device
from crowd.results.reading.transferring.rows import CorrelationMatrix, Winner

PEARSON, SPEARMAN = "pearson", "spearman"
KINDS = (PEARSON, SPEARMAN)


@dataclass(frozen=True)
class DeviceSimilarity:
    """Similarity of a device to `others` devices: median and smallest coefficient.

    `least_with`: the device of the smallest one. `number`: its place in the matrix, from 1.
    """

    number: int
    device: Device
    sessions: int
    others: int
    median: float
    least: float
    least_with: Device


def ordered(rows: Sequence[Winner]) -> list[Winner]:
    """`rows` by ascending regret; those without a valid figure of the reference's fastest come last."""
    return sorted(
        rows,
        key=lambda row: (row.regret is None, row.regret or 0.0, row.reference_rank or 0, row.device.slug),
    )


def coefficients(matrix: CorrelationMatrix, kind: str) -> NDArray[np.float64]:
    """The coefficients of `matrix` of the `kind`."""
    return matrix.pearson if kind == PEARSON else matrix.spearman


def pairs(matrix: CorrelationMatrix, kind: str) -> NDArray[np.float64]:
    """The coefficients of all pairs of devices, (pairs,), without undefined ones."""
    values = coefficients(matrix, kind)
    upper = values[np.triu_indices(len(matrix.devices), 1)]
    return upper[np.isfinite(upper)]


def similarities(matrix: CorrelationMatrix, kind: str) -> list[DeviceSimilarity]:
    """The devices of `matrix` with at least one coefficient, in order."""
    values = coefficients(matrix, kind)
    return [
        DeviceSimilarity(
            number=number + 1,
            device=device,
            sessions=matrix.sessions[number],
            others=int(np.isfinite(values[number]).sum()),
            median=float(np.nanmedian(values[number])),
            least=float(np.nanmin(values[number])),
            least_with=matrix.devices[int(np.nanargmin(values[number]))],
        )
        for number, device in enumerate(matrix.devices)
        if np.isfinite(values[number]).any()
    ]
