"""Does the front transfer? What winners and correlations say, for the page to put in words."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from crowd.results.reading.rows import Device
from crowd.results.reading.transferring.rows import CorrelationMatrix, Winner

PEARSON, SPEARMAN = "pearson", "spearman"
KINDS = (PEARSON, SPEARMAN)


@dataclass(frozen=True)
class Alike:
    """How alike a device is to the others: median and least coefficient over OTHERS, and the device of the
    least. `number`, from 1, is its place in the matrix.
    """

    number: int
    device: Device
    sessions: int
    others: int
    median: float
    least: float
    least_with: Device


def ordered(rows: Sequence[Winner]) -> list[Winner]:
    """ROWS with the least loss first; those whose best has no valid figure last."""
    return sorted(
        rows,
        key=lambda row: (row.regret is None, row.regret or 0.0, row.best_rank or 0, row.device.slug),
    )


def coefficients(matrix: CorrelationMatrix, kind: str) -> np.ndarray:
    """The array of MATRIX that KIND names."""
    return matrix.pearson if kind == PEARSON else matrix.spearman


def pairs(matrix: CorrelationMatrix, kind: str) -> np.ndarray:
    """The coefficient of each pair of devices once, (pairs,); pairs without one are left out."""
    values = coefficients(matrix, kind)
    upper = values[np.triu_indices(len(matrix.devices), 1)]
    return upper[np.isfinite(upper)]


def alike(matrix: CorrelationMatrix, kind: str) -> list[Alike]:
    """Each device of MATRIX that has a coefficient with another, in their order."""
    values = coefficients(matrix, kind)
    return [
        Alike(
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
