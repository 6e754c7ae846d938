"""Predictions from a prior for this device, as far as its measurements confirm them.

Devices rarely agree in their values and often in their order, so only a straight line is assumed between the
(log) values of the two, objective by objective. Its slope is learned from the measurements here, and counts
only where it is significant: an unrelated source gets a slope of zero and is ignored, a reversed one a
negative slope. The models of the search then learn the residuals.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pareto.search.history import History
from pareto.search.prior import Prior
from pareto.search.targets import Targets
from pareto.spaces.grid import Indices
from pareto.surrogates.line import Line, fitted_line

Array = NDArray[np.float64]

ENOUGH = 8  # measurements here below which a source is trusted without a check
LIKELY = math.sqrt(2)  # standard errors: a trial costs one measurement, but a line affects every model


class Trend:
    """Predictions from a prior, as far as the measurements here confirm them; zero without a prior.

    `slope` holds, for each objective, that of this device's values over the source's.
    """

    def __init__(self, prior: Prior | None, slope: Array, offset: Array) -> None:
        self._prior = prior
        self.slope = slope
        self._offset = offset

    @classmethod
    def of(cls, prior: Prior | None, targets: Targets) -> Trend:
        """Fit a line for each objective to the measurements here."""
        if not prior:
            nothing = np.zeros(targets.values.shape[1])
            return cls(None, nothing, nothing)
        lines = _lines(prior, targets)
        slope = np.array([line.slope for line in lines])
        offset = np.array([line.offset for line in lines])
        return cls(prior if slope.any() else None, slope, offset)

    def __call__(self, indices: Indices) -> Array:
        """Return (n, objectives) targets; zero where nothing is confirmed."""
        if self._prior is None:
            return np.zeros((len(indices), len(self.slope)))
        line = self._offset + self.slope * self._prior.expected(indices)
        return np.where(self.slope == 0, 0.0, line)

    def rest(self, targets: Targets) -> Array:
        """Return (n, objectives) residuals of the winsorised targets.

        The line is winsorised likewise, so a point that is bad on both devices has residual 0.
        """
        ours = targets.winsorised()
        line = np.minimum(self(targets.indices), ours.max(axis=0))
        return ours - np.where(self.slope == 0, 0.0, line)


def trusted(history: History, prior: Prior | None) -> bool:
    """Return whether the source's points are worth trying: at first, and while all slopes seem to rise."""
    if not prior:
        return False
    indices, _ = history.measured()
    if len(indices) < ENOUGH:
        return True
    return all(line.t > LIKELY for line in _lines(prior, Targets.of(history)))


def _lines(prior: Prior, targets: Targets) -> list[Line]:
    """Return for each objective the line from the source's predictions to the measurements here.

    Censored values are left out, unless all are.
    """
    lines = []
    for theirs, ours, censored in zip(
        prior.expected(targets.indices).T, targets.values.T, targets.censored.T, strict=True
    ):
        rows = ~censored if not censored.all() else censored
        lines.append(fitted_line(theirs[rows], ours[rows]))
    return lines
