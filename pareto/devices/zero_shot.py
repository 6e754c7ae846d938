"""Another device's front, ordered by the values expected on this one after few measurements here, or none."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pareto.errors import ObjectiveError
from pareto.fronts.objective import Objective, read_limits, read_objectives, read_values
from pareto.search.history import History
from pareto.search.prior import Prior
from pareto.spaces.grid import Indices
from pareto.spaces.space import Configuration, Space
from pareto.surrogates.gaussian import GaussianProcess
from pareto.surrogates.line import fitted_line

Array = NDArray[np.float64]
ENOUGH = 5  # common measurements needed to fit a model

Pairs = Iterable[tuple[Mapping[str, Any], Mapping[str, float] | None]]


@dataclass(frozen=True)
class ExpectedPoint:
    """A configuration of the source's front, with its values there and the expected values here.

    `expected` holds the values measured here if `measured`; `within`: whether it keeps the limits.
    """

    configuration: Configuration
    source: dict[str, float]
    expected: dict[str, float]
    measured: bool
    within: bool


def expected_points(
    space: Space,
    objectives: Iterable[str | Objective],
    source: Pairs,
    here: Pairs = (),
    *,
    prefer: str | None = None,
    limits: Mapping[str, float] | None = None,
    count: int | None = None,
) -> list[ExpectedPoint]:
    """Return the source's front, the best in objective `prefer` first, those expected to break `limits` last.

    `source` and `here` are (configuration, values or None for a failure) pairs of the two devices; failures
    here and censored values on either device are left out. `prefer` is the first objective unless given. With
    `count`, that many of the source's configurations are taken, front after front.

    Without measurements here, the source's values are returned unchanged. Measurements here of configurations
    that the source measured, too, move them. One measurement scales all by its factor (or shifts them by a
    difference, where not all values are positive). With more they move by a line between logarithms; its
    slope differs from 1 only as far as the measurements support it. From ENOUGH on, a Gaussian process learns
    the residuals of the line: only this can change the order.

    Raises ConfigurationError or ObjectiveError for bad pairs, limits or an unknown `prefer`.
    """
    wanted = read_objectives(objectives)
    names = [objective.name for objective in wanted]
    if prefer is not None and prefer not in names:
        raise ObjectiveError(f"prefer = {prefer!r} is not an objective: they are {', '.join(names)}")
    target = _history(space, wanted, limits, here)
    prior = Prior.read(space, wanted, {}, source)
    theirs, ours = _exact(prior.source), _exact(target)
    left_out = target.results.keys() - ours.keys()
    indices = prior.source.front()[0] if count is None else prior.ranked(count)
    values = np.array([theirs[index] for index in indices.tolist()]).reshape(len(indices), len(wanted))
    expected = _moved(space, indices, values, theirs, ours)
    points = []
    for index, row, guess in zip(indices.tolist(), values, expected, strict=True):
        if index in left_out:
            continue
        now = ours.get(index, guess)
        within = bool(target.within_limits(now[None])[0])
        points.append(
            ExpectedPoint(space.decode(index), _named(names, row), _named(names, now), index in ours, within)
        )
    best = wanted[names.index(prefer) if prefer else 0]
    return sorted(points, key=lambda item: (not item.within, best.sign * item.expected[best.name]))


def _exact(history: History) -> dict[int, Array]:
    """Return the (objectives) values of uncensored successes, by index."""
    indices, values = history.measured()
    exact = history.exact()
    return dict(zip(indices[exact].tolist(), values[exact], strict=True))


def _history(
    space: Space, objectives: tuple[Objective, ...], limits: Mapping[str, float] | None, pairs: Pairs
) -> History:
    history = History(space, objectives, read_limits(objectives, limits))
    for configuration, values in pairs:
        read = None if values is None else read_values(objectives, values)
        history.record(space.encode(configuration), read)
    return history


def _moved(
    space: Space, indices: Indices, values: Array, theirs: Mapping[int, Array], ours: Mapping[int, Array]
) -> Array:
    """Return the (n, objectives) values expected here, from the source's and the common configurations."""
    common = [index for index in ours if index in theirs]
    if not common or len(values) == 0:
        return values
    x, y = np.array([theirs[index] for index in common]), np.array([ours[index] for index in common])
    moved = np.empty_like(values)
    for column in range(values.shape[1]):
        a, b, rest = x[:, column], y[:, column], values[:, column]
        positive = min(a.min(), b.min(), rest.min()) > 0
        if positive:
            a, b, rest = np.log(a), np.log(b), np.log(rest)
        line = fitted_line(a, b - a)  # of the difference: without a reason for another slope it stays 1
        guess = rest + line.offset + line.slope * rest
        left = b - a - line.offset - line.slope * a
        if len(common) >= ENOUGH:
            features, owner = space.features(common), space.feature_owner
            process = GaussianProcess.fit(features, left, owner, np.random.default_rng(0))
            guess += process.at(space.features(indices)).mean
        moved[:, column] = np.exp(guess) if positive else guess
    return moved


def _named(names: list[str], row: Array) -> dict[str, float]:
    return dict(zip(names, map(float, row), strict=True))
