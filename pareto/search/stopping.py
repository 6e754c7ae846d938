"""Ending a measurement early: what it has shown so far is worse than a limit, or than a finished point.

A condition maps objectives to values. A measurement ends once it is worse than all of them. No ranking by
unfinished values ever ends one: early errors order configurations badly.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pareto.errors import ObjectiveError
from pareto.fronts.censored import Censored
from pareto.fronts.objective import Objective, read_number
from pareto.search.history import History
from pareto.search.noise import Noise
from pareto.search.targets import Targets

Condition = Mapping[str, float]

SURE = 1.96  # standard deviations of a difference: faster by more than the noise
EARLY = 0.05  # share by which an estimate may be wrong
REMEDY = "report numbers only"


@dataclass(frozen=True)
class Stop:
    """Why a measurement ends early, and its `values` to tell, bounds among them Censored.

    They are in the order of the objectives. `values` is None, a failure, where the measurement has not
    reported every objective.
    """

    reason: str
    values: dict[str, float] | None


def stop_conditions(history: History) -> list[Condition]:
    """Return the limits, and the front of finished points with a margin for the noise where that is known."""
    conditions: list[Condition] = [{name: limit} for name, limit in history.limits.items()]
    if not history.exact().any():
        return conditions
    targets = Targets.of(history)
    noise = Noise.of(history, targets)
    if noise.repeats:
        # Of the difference of two measurements, where the noise is largest.
        margin = SURE * np.sqrt(2.0 * noise.variance.max(axis=0))
        names = [objective.name for objective in history.objectives]
        ends = targets.scale.natural(targets.whole_front + margin)
        conditions += [dict(zip(names, row, strict=True)) for row in ends.tolist()]
    return conditions


def find_stop(
    objectives: Sequence[Objective],
    conditions: Sequence[Condition],
    bounds: Mapping[str, float],
    estimates: Mapping[str, float],
) -> Stop | None:
    """Return why a measurement ends, or None.

    Its final values are those of `bounds` or worse, and about those of `estimates`, which are wrong by EARLY
    at most. Raises ObjectiveError for a name that is not an objective, or a value that is not finite.
    """
    signs = {objective.name: objective.sign for objective in objectives}
    values: dict[str, float] = {
        name: Censored(read_number(name, value, REMEDY)) for name, value in bounds.items()
    }
    values |= {name: read_number(name, value, REMEDY) for name, value in estimates.items()}
    if unknown := sorted(values.keys() - signs.keys()):
        raise ObjectiveError(f"report has {unknown[0]!r}, which is not an objective: {', '.join(signs)} are")

    def least(name: str) -> float:
        """The best that the final value can be, minimised; nothing is known of what was not reported."""
        value = values.get(name, -math.inf * signs[name]) * signs[name]
        return value - EARLY * abs(value) if name in estimates else value

    for condition in conditions:
        if all(least(name) > end * signs[name] for name, end in condition.items()):
            ends = " and ".join(
                f"{name} {values[name]:.4g} (beyond {end:.4g})" for name, end in condition.items()
            )
            ordered = {name: values[name] for name in signs if name in values}
            return Stop(f"stopped early: {ends}", ordered if len(ordered) == len(signs) else None)
    return None
