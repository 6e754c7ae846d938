"""Why an exploration has no answer, with a remedy."""

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

SHOWN = 8  # runs that must agree before a parameter is said to change nothing
ENOUGH = 10  # different configurations that must agree before an objective is called constant


def obstacle(history: History) -> NoAnswerError | None:
    """Return the reason why `history` has no useful front, or None.

    The search can go on regardless: its next proposals may remove the obstacle.
    """
    if not history.results:
        return NothingMeasuredError(
            "nothing was measured yet: call ask() for configurations and tell() with their values"
        )
    indices, values = history.measured()
    if len(indices) == 0:
        return AllFailedError(
            f"all {len(history.results)} configurations failed: find out why, beginning with the default"
        )
    exact = history.exact()
    if not exact.any():
        return NothingFeasibleError(
            f"each of {len(values)} measured configurations has a censored value, this or worse: measure one "
            "of them in full, or go on exploring"
        )
    values = values[exact]
    if not history.within_limits(values).any():
        return _nothing_feasible(history, values, len(indices))
    if len(values) >= ENOUGH and not np.ptp(values, axis=0).any():
        named = " and ".join(
            f"{objective.name!r} ({value:g})"
            for objective, value in zip(history.objectives, values[0], strict=True)
        )
        return ConstantObjectiveError(
            f"{named} did not differ between {len(values)} configurations: look whether "
            "anything is really measured"
        )
    return None


def constant_objectives(history: History) -> dict[str, float]:
    """Return the objectives that had one value in all of ENOUGH successful configurations or more.

    Configurations with a censored value do not count.
    """
    _, values = history.measured()
    values = values[history.exact()]
    if len(values) < ENOUGH:
        return {}
    return {
        objective.name: float(column[0])
        for objective, column in zip(history.objectives, values.T, strict=True)
        if not np.ptp(column)
    }


def parameters_without_effect(history: History) -> dict[str, int]:
    """Return the parameters that changed nothing, each with the number of runs that show it.

    These are SHOWN runs or more that differ from another one in that parameter only, and whose objectives are
    equal to the last digit. A run that failed beside one that did not is a difference.
    """
    outcomes: dict[int, tuple[float, ...] | None] = dict.fromkeys(history.failed().tolist())
    indices, values = history.measured()
    exact = history.exact()
    outcomes |= zip(indices[exact].tolist(), map(tuple, values[exact].tolist()), strict=True)
    points = {index: tuple(history.space.decode(index).values()) for index in outcomes}
    found = {}
    for position, name in enumerate(history.space.names):
        alike: dict[tuple[object, ...], list[int]] = {}
        for index, point in points.items():
            alike.setdefault(point[:position] + point[position + 1 :], []).append(index)
        groups = [[outcomes[index] for index in group] for group in alike.values() if len(group) > 1]
        runs = sum(len(group) for group in groups if None not in group)
        if runs >= SHOWN and all(len(set(group)) == 1 for group in groups):
            found[name] = runs
    return found


def _nothing_feasible(history: History, values: np.ndarray, measured: int) -> NothingFeasibleError:
    """Return the error for so many `measured` configurations, of which `values` are known exactly."""
    limits: Mapping[str, float] = history.limits
    wanted, nearest = [], []
    for objective, column in zip(history.objectives, values.T, strict=True):
        if objective.name in limits:
            sign = ">=" if objective.maximise else "<="
            best = column.max() if objective.maximise else column.min()
            wanted.append(f"{objective.name} {sign} {limits[objective.name]:g}")
            nearest.append(f"{objective.name} = {best:g}")
    return NothingFeasibleError(
        f"none of {measured} measured configurations keeps {' and '.join(wanted)}; the best of each are "
        f"{', '.join(nearest)}: relax a limit, or go on exploring"
    )
