"""The recommended front: by posterior means, so that lucky measurements drop out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from pareto.search.history import History
from pareto.search.models import Models
from pareto.search.noise import Noise
from pareto.search.prior import Prior
from pareto.search.targets import FEW, Targets
from pareto.search.trend import Trend
from pareto.spaces.grid import Indices
from pareto.spaces.space import Configuration

Array = NDArray[np.float64]

POINTS = 1000  # measurements that the models learn from


class Recommended(NamedTuple):
    """A configuration, its expected `values`, and their 95 % `intervals` (low, high).

    The interval is about the expected value, not about one measurement. Where repeats agree, or nothing was
    repeated, values are the measured ones and intervals have no width.
    """

    configuration: Configuration
    values: dict[str, float]
    intervals: dict[str, tuple[float, float]]


@dataclass(frozen=True)
class Estimates:
    """Of successes: (n,) `indices`, (n, objectives) `expected` values, and the `low` and `high` ends.

    The ends are those of 95 % intervals, in natural values. `noisy`: whether repeats differed; otherwise
    all three are the measured values. A censored value is its bound in all three.
    """

    indices: Indices
    expected: Array
    low: Array
    high: Array
    noisy: bool


def is_noisy(history: History) -> bool:
    """Return whether two measurements of any configuration differed; censored ones do not count."""
    return any(len(set(values)) > 1 for values in history.repeats())


def estimate(history: History, prior: Prior | None = None) -> Estimates:
    """Return the expected values of successes: posterior means where repeats differ.

    A handful of configurations is too few for a model: their measured values are returned.
    """
    indices, values = history.measured()
    if not is_noisy(history):
        return Estimates(indices, values, values, values, False)
    targets = Targets.of(history)
    if 4 * len(indices) < FEW:
        mean, noise = targets.values, Noise.of(history, targets)
        deviation = np.sqrt(noise.variance / history.counts()[:, None])
    else:
        with threadpool_limits(limits=1, user_api="blas"):
            models = Models(history, targets, Trend.of(prior, targets), POINTS, np.random.default_rng(0))
            (mean, deviation), noise = models.estimates, models.noise
    natural = targets.scale.natural
    width = noise.half_width() * deviation
    ends = np.stack([natural(mean - width), natural(mean + width)])
    as_measured = (mean == targets.values) | targets.censored  # to the last digit
    certain = (deviation == 0) | targets.censored
    expected = np.where(as_measured, values, natural(mean))
    low, high = (np.where(certain, values, end) for end in (ends.min(axis=0), ends.max(axis=0)))
    return Estimates(indices, expected, low, high, True)


def recommend(history: History, estimates: Estimates) -> list[Recommended]:
    """Return the non-dominated configurations by expected values within limits, by the first objective.

    A configuration with a censored value is not among them.
    """
    expected, low, high = estimates.expected, estimates.low, estimates.high
    names = [objective.name for objective in history.objectives]
    return [
        Recommended(
            history.space.decode(int(estimates.indices[row])),
            dict(zip(names, expected[row].tolist(), strict=True)),
            dict(zip(names, zip(low[row].tolist(), high[row].tolist(), strict=True), strict=True)),
        )
        for row in history.front_rows(expected)
    ]
