"""Why an exploration has no answer, in words that say what to do."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pareto.errors import (
    AllFailedError,
    ConstantObjectiveError,
    NoAnswerError,
    NothingFeasibleError,
    NothingMeasuredError,
)
from pareto.search.history import History

ENOUGH = 10  # different configurations that must agree before an objective is called constant


def obstacle(history: History) -> NoAnswerError | None:
    """Return what stands between `history` and a front worth reading; None when nothing does.

    The search itself goes on through all of it: what it asks for next may remove the obstacle.
    """
    if not history.told:
        return NothingMeasuredError("nothing was measured yet: ask for configurations and tell their values")
    indices, values = history.measured()
    if len(indices) == 0:
        return AllFailedError(
            f"all {len(history.told)} configurations failed: find out why one of them does, the default first"
        )
    if not history.within_limits(values).any():
        return _nothing_feasible(history, values)
    if len(indices) >= ENOUGH and not np.ptp(values, axis=0).any():
        named = " and ".join(
            f"{objective.name!r} ({value:g})"
            for objective, value in zip(history.objectives, values[0], strict=True)
        )
        return ConstantObjectiveError(
            f"{named} did not differ between {len(indices)} configurations: look whether "
            "anything is really measured"
        )
    return None


def constant_objectives(history: History) -> dict[str, float]:
    """Return the objectives that had one value in all of ENOUGH successful configurations or more."""
    indices, values = history.measured()
    if len(indices) < ENOUGH:
        return {}
    return {
        objective.name: float(column[0])
        for objective, column in zip(history.objectives, values.T, strict=True)
        if not np.ptp(column)
    }


def _nothing_feasible(history: History, values: np.ndarray) -> NothingFeasibleError:
    limits: Mapping[str, float] = history.limits
    wanted, nearest = [], []
    for objective, column in zip(history.objectives, values.T, strict=True):
        if objective.name in limits:
            sign = ">=" if objective.maximise else "<="
            best = column.max() if objective.maximise else column.min()
            wanted.append(f"{objective.name} {sign} {limits[objective.name]:g}")
            nearest.append(f"{objective.name} = {best:g}")
    return NothingFeasibleError(
        f"none of {len(values)} measured configurations keeps {' and '.join(wanted)}; the best of each are "
        f"{', '.join(nearest)}: relax a limit, or go on exploring"
    )
