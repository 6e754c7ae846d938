"""The interface of search methods."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, fields
from typing import Any, ClassVar

import numpy as np

from pareto.search.history import History
from pareto.search.prior import Prior
from pareto.spaces.space import Space

RANDOM, ACTIVE, AGAIN = "random", "active", "again"  # phases: AGAIN measures a known point once more


class Method:
    """Proposes the next measurements from the history.

    A dataclass: its fields with defaults are its options, all of them whole numbers. A method keeps only its
    `memory` between proposals. `uses_prior`: whether it uses another device's measurements; the explorer then
    sets its `prior`. `budget`: the planned number of measurements, if it is known. `whole_rounds`: whether it
    is asked for a round at once, because it cannot remember parts of it.
    """

    uses_prior: ClassVar[bool] = False
    whole_rounds: ClassVar[bool] = False
    seed: int = 0  # the explorer's, for draws that must not depend on the number of calls
    prior: Prior | None = None
    budget: int | None = None

    def propose(self, history: History, count: int, rng: np.random.Generator) -> list[tuple[int, str]]:
        """Return up to `count` (index, phase) pairs; fewer to wait or to end.

        None is pending. All are distinct and without results, except those of phase AGAIN.
        """
        raise NotImplementedError

    def memory(self) -> dict[str, Any]:
        """Return the state beyond the history as plain JSON."""
        return {}

    def recall(self, memory: Mapping[str, Any], space: Space) -> None:
        """Restore what `memory` returned.

        Raises StateError, or what reading plain JSON of another shape raises, when it is damaged.
        """

    @classmethod
    def defaults(cls) -> dict[str, int | None]:
        """Return the options and their default values, None where the method decides."""
        options = fields(cls)  # type: ignore[arg-type]
        return {item.name: item.default for item in options if item.init and item.default is not MISSING}
