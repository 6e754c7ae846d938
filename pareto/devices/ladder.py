"""Which rung predicts best, by cross-validation: each family is predicted from the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pareto.devices.device_map import SEPARATOR, DeviceMap
from pareto.devices.prediction import Belief, Observation
from pareto.devices.rungs import LEAST_FAMILIES, RUNGS, observations

Array = NDArray[np.float64]

FOLDS = 8  # families are left out in so many groups at most
WORTH = 0.97  # a higher rung is taken where its error is at most this part of the lower one's
LEAST_RESIDUALS = 100  # enough residuals to calibrate the width of intervals
LEAST_SCALE = 0.5
LEAST_HELD_OUT = 3  # families with a measurement beyond the standard session
QUANTILE_95 = 1.959964
COLUMNS = ("rung", "device", "family", "configuration", "predicted", "measured", "deviation")


@dataclass(frozen=True)
class Ladder:
    """The chosen `rung` with its `belief` about an unseen device.

    Intervals are `scale` times as wide as the belief's (`interval`). `residuals` (COLUMNS): each prediction
    of a ratio from other families, with the belief's deviation, as logarithms.
    """

    rung: str
    belief: Belief
    scale: float
    residuals: pd.DataFrame


def interval(belief: Belief, scale: float) -> tuple[Array, Array]:
    """95 % intervals of `belief`, widened by `scale`: low and high, (quantities,)."""
    half = QUANTILE_95 * scale * belief.deviation
    return belief.mean - half, belief.mean + half


def climb(known: DeviceMap, session: Sequence[str]) -> Ladder:
    """The best rung for `known`.

    `session`: the configurations that every session measures in addition to the default.

    The error of a rung is the median relative error of the ratios of other configurations, predicted from
    `session` and its stages. Where fewer than LEAST_HELD_OUT families measured others, the rung is `stages`
    if the work is known, else `power`.
    """
    candidates = [name for name in RUNGS if _possible(name, known)]
    residuals = held_out(known, session, candidates)
    if residuals.family.nunique() < LEAST_HELD_OUT:
        rung = "stages" if "stages" in candidates else "power"
        return Ladder(rung, RUNGS[rung](known), 1.0, residuals)
    errors = error_of(residuals)
    rung = candidates[0]
    for name in candidates[1:]:
        if errors[name] <= WORTH * errors[rung]:
            rung = name
    return Ladder(rung, RUNGS[rung](known), _scale(residuals[residuals.rung == rung]), residuals)


def held_out(known: DeviceMap, session: Sequence[str], rungs: Sequence[str]) -> pd.DataFrame:
    """The predictions of each of `rungs` for each family from the other families, as in
    `Ladder.residuals`."""
    taught = [name for name in known.ratios.columns if SEPARATOR in name or name in session]
    tested = [name for name in known.configurations if name not in session]
    useful = known.of(known.ratios.index[known.ratios[tested].notna().any(axis=1)])
    families = sorted(useful.families.unique())
    rows = []
    for fold in range(min(FOLDS, len(families))):
        left_out = families[fold::FOLDS]
        others = known.without_families(left_out)
        target = useful.of(useful.ratios.index[useful.families.isin(left_out)])
        for rung in rungs:
            rows += _predicted(rung, RUNGS[rung](others), target, taught, tested)
    return pd.DataFrame(rows, columns=list(COLUMNS))


def error_of(residuals: pd.DataFrame) -> pd.Series:
    """The median relative error of the predicted ratios, by rung."""
    relative = np.abs(np.expm1(residuals.predicted - residuals.measured))
    return relative.groupby(residuals.rung).median()


def _possible(rung: str, known: DeviceMap) -> bool:
    if rung == "stages":
        return known.work is not None
    return rung != "devices" or known.families.nunique() >= LEAST_FAMILIES


def _predicted(
    rung: str, belief: Belief, target: DeviceMap, taught: Sequence[str], tested: Sequence[str]
) -> list[tuple[object, ...]]:
    rows: list[tuple[object, ...]] = []
    columns = target.ratios.columns
    allowed = columns.isin(list(taught))
    asked = np.flatnonzero(columns.isin(list(tested)))
    ratios = target.ratios.to_numpy(float)
    for position, seen in enumerate(observations(target)):
        kept = allowed[seen.places]
        after = belief.after(Observation(seen.places[kept], seen.values[kept], seen.errors[kept]))
        deviation = after.deviation
        device = target.ratios.index[position]
        for quantity in asked[~np.isnan(ratios[position, asked])]:
            name = columns[quantity]
            measured = ratios[position, quantity]
            row = (after.mean[quantity], measured, deviation[quantity])
            rows.append((rung, device, target.families.iloc[position], name, *row))
    return rows


def _scale(residuals: pd.DataFrame) -> float:
    """The factor on the width of intervals with which they cover 95 % of the residuals."""
    if len(residuals) < LEAST_RESIDUALS:
        return 1.0
    standardised = np.abs(residuals.predicted - residuals.measured) / residuals.deviation
    return max(LEAST_SCALE, float(np.quantile(standardised, 0.95)) / QUANTILE_95)
