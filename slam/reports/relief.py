"""The relief of a surface measured in several rounds: its shape, apart from the noise of its measurements."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from slam.reports.surface import Grid, is_log

# Standard errors by which a difference must exceed zero: by chance alone once in 30,000 comparisons.
SURE = 4.0
Cell = tuple[int, int]  # row of y, column of x


@dataclass(frozen=True)
class Relief:
    """What is sure of the times of a grid.

    `noise` is the standard deviation of the logarithm of one measurement, without what changed for the whole
    round; `shape` that of the cells themselves, without noise. `minima` are cells at the bottom of basins
    that no path leaves without climbing by more than noise. `bends` counts cells that lie above the line
    between their neighbours in a row or column by more than noise, of all `triples`: none of a convex
    surface. `cliff` is the largest ratio of two neighbours.
    """

    rounds: int
    noise: float
    shape: float
    minima: tuple[Cell, ...]
    bends: int
    triples: int
    cliff: float

    @classmethod
    def of(cls, grid: Grid, times: NDArray[np.float64]) -> Relief:
        """Read (rounds, y, x) `times` of at least two rounds.

        Cells with a failed measurement (NaN) take no part.
        """
        rounds = len(times)
        logs = np.log(times)
        known = np.isfinite(logs).all(axis=0)
        logs = np.where(known, logs, np.nan)
        logs = logs - np.nanmean(logs, axis=(1, 2), keepdims=True)
        cells = logs.mean(axis=0)
        freedom = (rounds - 1) * (int(known.sum()) - 1)
        noise = math.sqrt(float(np.nansum((logs - cells) ** 2)) / freedom)
        shape = math.sqrt(max(float(np.nanvar(cells, ddof=1)) - noise**2 / rounds, 0.0))
        error = noise / math.sqrt(rounds)
        bends, triples = _bends(grid, np.where(known, times.mean(axis=0), np.nan), error)
        steps = [np.abs(np.diff(cells, axis=axis)) for axis in (0, 1)]
        return cls(
            rounds,
            noise,
            shape,
            _minima(cells, SURE * math.sqrt(2) * error),
            bends,
            triples,
            math.exp(max(float(np.nanmax(step)) for step in steps)),
        )

    @property
    def counted(self) -> str:
        """The number of minima in words."""
        return f"{len(self.minima)} separate minim{'um' if len(self.minima) == 1 else 'a'}"

    @property
    def blurred(self) -> bool:
        """Whether differences as large as the shape are not sure: more rounds may show what these do not."""
        return SURE * math.sqrt(2 / self.rounds) * self.noise > self.shape

    def describe(self) -> str:
        """The relief in sentences."""
        return (
            f"{self.rounds} rounds: a single time varies by {100 * self.noise:.1f} %, and the surface by "
            f"{100 * self.shape:.0f} %. It has {self.counted} beyond noise, and "
            f"bends downwards at {self.bends} of {self.triples} places where a convex one "
            f"cannot. Neighbours differ by a factor of up to {self.cliff:.2f}."
        )


def _minima(cells: NDArray[np.float64], least: float) -> tuple[Cell, ...]:
    """The bottoms of all basins that are deeper than `least`, deepest first.

    Cells are flooded in ascending order. Where two basins meet, the shallower one ends; it counts if its
    bottom lies by more than `least` below (topological persistence, Edelsbrunner et al. 2002).
    """
    height = {
        (row, column): float(cells[row, column])
        for row, column in product(*map(range, cells.shape))
        if np.isfinite(cells[row, column])
    }
    bottom: dict[Cell, Cell] = {}  # of the basin that a flooded cell belongs to
    minima: list[Cell] = []
    for cell in sorted(height, key=height.__getitem__):
        around = [(cell[0] + down, cell[1] + across) for down, across in product((-1, 0, 1), repeat=2)]
        basins = sorted({bottom[near] for near in around if near in bottom}, key=height.__getitem__)
        bottom[cell] = basins[0] if basins else cell
        for shallow in basins[1:]:
            if height[cell] - height[shallow] > least:
                minima.append(shallow)
            bottom |= {near: basins[0] for near, lowest in bottom.items() if lowest == shallow}
    return tuple(sorted({*minima, *bottom.values()}, key=height.__getitem__))


def _bends(grid: Grid, times: NDArray[np.float64], error: float) -> tuple[int, int]:
    """How many cells of the mean `times` (y, x) lie above the line between their neighbours, and of how many.

    `error` is the relative standard error of a mean. Places are those of the values, on the axis's scale.
    """
    bends = triples = 0
    for values, rows in ((grid.x_values, times), (grid.y_values, times.T)):
        places = np.log(values) if is_log(values) else np.array(values)
        left = (places[2:] - places[1:-1]) / (places[2:] - places[:-2])
        chord = left * rows[:, :-2] + (1 - left) * rows[:, 2:]
        variance = rows[:, 1:-1] ** 2 + (left * rows[:, :-2]) ** 2 + ((1 - left) * rows[:, 2:]) ** 2
        above = rows[:, 1:-1] - chord
        bends += int((above > SURE * error * np.sqrt(variance)).sum())
        triples += int(np.isfinite(above).sum())
    return bends, triples
