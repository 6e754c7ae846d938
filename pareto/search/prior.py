"""Measurements of another device: which of its points to try first, and predictions from them."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pareto.errors import ObjectiveError
from pareto.fronts.front import nondominated
from pareto.fronts.objective import Objective, read_values
from pareto.search.history import History
from pareto.search.targets import Targets
from pareto.spaces.grid import Indices
from pareto.spaces.space import Space
from pareto.surrogates.forest import LARGEST_GRID, Forest

Array = NDArray[np.float64]

TREES = 100
REACH = 4  # how far down its list the most different one is searched


class Prior:
    """Measurements of the same space by another device, the source; none of them counts as measured here."""

    def __init__(self, space: Space, objectives: tuple[Objective, ...], limits: Mapping[str, float]) -> None:
        """Start empty. `limits` are this device's: they rank points and exclude none."""
        self.source = History(space, objectives, limits={})
        self._limits = dict(limits)

    @classmethod
    def read(
        cls,
        space: Space,
        objectives: tuple[Objective, ...],
        limits: Mapping[str, float],
        pairs: Iterable[tuple[Mapping[str, Any], Mapping[str, float] | None]],
    ) -> Prior:
        """Read (configuration, values or None for a failure) pairs, averaged by configuration.

        Raises ConfigurationError or ObjectiveError as `Explorer.tell` does.
        """
        prior = cls(space, objectives, limits)
        for pair in pairs:
            try:
                configuration, values = pair
            except (TypeError, ValueError):
                raise ObjectiveError(
                    f"a prior is (configuration, values or None for a failure) pairs, not {pair!r}"
                ) from None
            read = None if values is None else read_values(objectives, values)
            prior.source.record(space.encode(configuration), read)
        return prior

    def __bool__(self) -> bool:
        """Whether the source measured anything that did not fail."""
        return len(self.source.measured()[0]) > 0

    def ranked(self, count: int) -> Indices:
        """Return the source's best `count` configurations, the most promising first.

        Those that keep more of the limits on the source come first, since a limit in its values may be out of
        its reach; then front after front (non-dominated sorting); and within a front each next one is the
        farthest, in log values, from those before it. Those with a censored value are left out.
        """
        indices, values = self.source.measured()
        if len(indices) == 0:
            return indices
        scaled = Targets.of(self.source).values
        exact = self.source.exact()
        broken = np.zeros(len(indices), dtype=np.int64)
        for column, objective in enumerate(self.source.objectives):
            limit = self._limits.get(objective.name, np.inf * objective.sign)
            broken += values[:, column] * objective.sign > limit * objective.sign
        chosen: list[int] = []
        for number in np.unique(broken):
            left = np.flatnonzero((broken == number) & exact)
            while len(left) and len(chosen) < count:
                front = nondominated(scaled[left])
                chosen += left[front][_farthest_first(scaled[left[front]], count - len(chosen))].tolist()
                left = left[~front]
        return indices[chosen]

    def promising(self, count: int, exclude: Collection[int] = ()) -> Indices:
        """Return up to `count` configurations to try first, none in `exclude`, the most promising first.

        The best points of a device are often similar, and do well or badly together on another: the k-th to
        try is, among the best REACH * k, the one most different from those before it.
        """
        wanted = max(count, 0) + len(exclude)
        ranked = self.ranked(REACH * wanted)
        features = self.source.space.features(ranked)
        distance = np.full(len(ranked), np.inf)
        chosen: list[int] = []
        for number in range(min(wanted, len(ranked))):
            farthest = int(np.argmax(distance[: REACH * number + 1]))
            chosen.append(int(ranked[farthest]))
            distance = np.minimum(distance, np.abs(features - features[farthest]).sum(axis=1))
            distance[farthest] = -1.0
        free = [index for index in chosen if index not in set(exclude)]
        return np.array(free[: max(count, 0)], dtype=np.int64)

    def expected(self, indices: Indices) -> Array:
        """Return (n, objectives) values that the source measured or its model predicts.

        In the units of `Targets.values`: minimised, logarithms where all values are positive. A censored
        value counts as its bound.
        """
        if len(self.source.space) > LARGEST_GRID:
            codes = self.source.space.codes(indices)
            return np.stack([forest.predict(codes) for forest in self._forests], axis=1)
        return self._grid[indices]

    @cached_property
    def _grid(self) -> Array:
        return np.stack([forest.predict_grid() for forest in self._forests], axis=1)

    @cached_property
    def _forests(self) -> list[Forest]:
        # Extra trees are grown on all rows to purity: they return a measured value as it was measured.
        targets = Targets.of(self.source)
        space = self.source.space
        codes = space.codes(targets.indices)
        return [Forest.grow(codes, column, space.shape, seed=0, trees=TREES) for column in targets.values.T]


def _farthest_first(points: Array, count: int) -> NDArray[np.int64]:
    """Return positions of up to `count` rows: the best compromise, then each time the farthest from all."""
    scaled = (points - points.min(axis=0)) / np.maximum(np.ptp(points, axis=0), 1e-12)
    order = [int(np.argmin(scaled.sum(axis=1)))]
    distance = np.full(len(points), np.inf)
    while len(order) < min(count, len(points)):
        distance = np.minimum(distance, np.abs(scaled - scaled[order[-1]]).max(axis=1))
        distance[order] = -1.0
        order.append(int(np.argmax(distance)))
    return np.array(order)
