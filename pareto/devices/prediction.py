"""A Gaussian belief about the ratios of a device, and its update by measurements.

Quantities and logarithms are those of `pareto.devices.device_map`. Formulas: Rasmussen & Williams 2006,
eq. 2.23 to 2.24.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

Array = NDArray[np.float64]
Places = NDArray[np.intp]


@dataclass(frozen=True)
class Observation:
    """One device's measurements: the columns of its quantities, values and standard errors, (n,) each."""

    places: Places
    values: Array
    errors: Array

    def __len__(self) -> int:
        return len(self.places)


@dataclass(frozen=True)
class Belief:
    """`mean` (quantities,) and `covariance` (quantities, quantities) of a device's log ratios.

    `relation`, 0 to 1, is the correlation between two devices of one family in the same quantity.
    """

    mean: Array
    covariance: Array
    relation: float = 0.0

    def after(self, own: Observation, relatives: Sequence[Observation] = ()) -> Belief:
        """The belief about a device after it measured `own` and devices of its family measured
        `relatives`."""
        if self.relation == 0.0:
            relatives = ()
        seen = [own, *relatives]
        places = np.concatenate([one.places for one in seen])
        if not len(places):
            return self
        owner = np.repeat(np.arange(len(seen)), [len(one) for one in seen])
        values = np.concatenate([one.values for one in seen])
        noise = np.concatenate([one.errors for one in seen]) ** 2
        between = self.covariance[np.ix_(places, places)]
        between = between * np.where(owner[:, None] == owner, 1.0, self.relation)
        across = self.covariance[:, places] * np.where(owner == 0, 1.0, self.relation)
        factor = cho_factor(between + np.diag(noise + JITTER), lower=True)
        gain = cho_solve(factor, across.T).T
        mean = self.mean + gain @ (values - self.mean[places])
        return Belief(mean, self.covariance - gain @ across.T, self.relation)

    @property
    def deviation(self) -> Array:
        """Standard deviations, (quantities,)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))


JITTER = 1e-8  # keeps the matrix positive where two quantities are the same
