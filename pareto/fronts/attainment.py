"""Attainment: the regions that several runs of a search reach."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pareto.errors import ObjectiveError
from pareto.fronts.front import nondominated, signs


def attainment(
    runs: Sequence[ArrayLike], level: int, maximise: Sequence[bool] | None = None
) -> NDArray[np.float64]:
    """Return the `level`-th attainment surface: the best points that at least `level` of the `runs` attain.

    A run, measured points (n, objectives), attains a point when one of its points is not worse in any
    objective. Level 1 is the front of all runs together, `len(runs)` what every run reaches, and the middle
    one shows a typical run, which a mean of fronts cannot (Fonseca, Guerreiro, Lopez-Ibanez and Paquete 2011;
    computed by moocore). Rows with NaN are failures and attain nothing. Rows come by the first objective,
    distinct; none where fewer than `level` runs have measured anything. For up to three objectives.

    Raises ObjectiveError for more objectives, runs of different ones, or a level outside 1 .. len(runs).
    """
    if not 1 <= level <= len(runs):
        raise ObjectiveError(f"level {level} of {len(runs)} runs: it must be from 1 to the number of runs")
    tables = [np.asarray(run, dtype=np.float64) for run in runs]
    tables = [table for table in tables if table.size]
    widths = sorted({table.shape[-1] if table.ndim == 2 else 0 for table in tables})
    if len(widths) > 1 or any(width not in (1, 2, 3) for width in widths):
        raise ObjectiveError(f"runs must be tables of the same 1, 2 or 3 objectives, not of {widths} columns")
    fronts = [np.unique(table[nondominated(table, maximise)], axis=0) for table in tables]
    fronts = [front for front in fronts if len(front)]
    width = widths[0] if widths else 1
    if len(fronts) < level:
        return np.empty((0, width))
    sign = signs(maximise, width)
    points = np.concatenate(fronts) * sign
    if width == 1:
        return np.sort(points, axis=0)[level - 1 : level] * sign
    import moocore

    runs_of = np.repeat(np.arange(len(fronts)), [len(front) for front in fronts])
    surface = moocore.eaf(points, runs_of, percentiles=[100.0 * level / len(fronts)])[:, :-1]
    return np.unique(surface, axis=0) * sign
