"""The measurement noise of each objective, from repeats of configurations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from pareto.search.history import History
from pareto.search.targets import TINY, Targets

Array = NDArray[np.float64]

NEARBY = 0.5  # of the values' standard deviation: repeats so far away say less about the noise of a point
SHARED = 1.5  # repeats anywhere, together, say as much about it as so many at the point itself
INTERVAL = 0.95


@dataclass(frozen=True)
class Noise:
    """The (n, objectives) `variance` of one measurement, in targets, at each measured point.

    It is pooled over repeats, those of similar values first, since noise often grows as times fall.
    `freedom` (n, objectives) are its degrees of freedom, `repeats` the number of repeats. Without repeats it
    is unknown. If all of an objective agree, there is no noise.
    """

    variance: Array
    freedom: Array
    repeats: int

    @classmethod
    def of(cls, history: History, targets: Targets) -> Noise:
        """Pool the variance within each repeated configuration, without censored measurements."""
        groups = [targets.scale.targets(np.array(values)) for values in history.repeats()]
        if not groups:
            return cls(np.zeros_like(targets.values), np.zeros_like(targets.values), 0)
        # Deviations from the first: equal measurements then have variance 0, without rounding errors.
        squares = np.array([((group - group[0]).var(axis=0) * len(group)) for group in groups])
        freedom = np.array([len(group) - 1.0 for group in groups])
        centres = np.array([group.mean(axis=0) for group in groups])
        pooled = squares.sum(axis=0) / freedom.sum()
        variance, local = np.empty_like(targets.values), np.empty_like(targets.values)
        for number, values in enumerate(targets.values.T):
            distance = (values[:, None] - centres[:, number]) / max(NEARBY * float(values.std()), TINY)
            weight = np.exp(-0.5 * distance**2)
            local[:, number] = weight @ freedom + SHARED
            variance[:, number] = (weight @ squares[:, number] + SHARED * pooled[number]) / local[:, number]
        return cls(variance, np.minimum(local, freedom.sum()), int(freedom.sum()))

    def __bool__(self) -> bool:
        """Whether repeats differed."""
        return bool(self.variance.any())

    def expected(self, objective: int, nugget: float) -> Array:
        """Return the (n,) expected variances: the `nugget` of a process counts as much as one repeat.

        Few repeats say little about a variance, and the residuals of a smooth model bound it. An objective
        without repeats, or whose repeats all agree, has no noise.
        """
        variance, freedom = self.variance[:, objective], self.freedom[:, objective]
        if not variance.any():
            return variance
        return (freedom * variance + nugget) / (freedom + 1.0)

    def half_width(self) -> Array:
        """Return the (n, objectives) standard deviations to each side of an interval, by Student's t."""
        factors: Array = stdtrit(self.freedom, 0.5 + INTERVAL / 2)
        return factors


def describe_noise(history: History) -> str:
    """Return the median standard deviation of one measurement of each objective, as text."""
    if not history.repeats():
        return "noise: unknown, since no configuration was measured twice"
    targets = Targets.of(history)
    noise, scale = Noise.of(history, targets), targets.scale
    parts = []
    for objective, deviation, log, unit in zip(
        history.objectives, np.sqrt(np.median(noise.variance, axis=0)), scale.log, scale.unit, strict=True
    ):
        size = f"{100 * deviation:.2g} %" if log else f"{deviation * unit:.2g}"
        parts.append(f"{objective.name} {size if deviation else 'none'}")
    count = "one repeat" if noise.repeats == 1 else f"{noise.repeats} repeats"
    return f"noise of a measurement, from {count}: {', '.join(parts)}"
