"""Times from work: what a unit of each resource costs on the reference device.

Time = sum over resources of cost x work. The work of a configuration is known exactly. The costs on the
reference device follow from its times, by non-negative least squares of the relative errors: stage by stage
where the times of its stages are known, else from its whole times. On a device whose costs differ by factors
exp(d), ratios differ to first order by `sensitivities` @ d.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pareto.devices.device_map import DEFAULT, SEPARATOR

Array = NDArray[np.float64]
LEAST = 1e-9  # of the time of the default: a shorter one counts as this


@dataclass(frozen=True)
class WorkModel:
    """`ratios` (quantities,): the logarithms that costs and work give on the reference device, infinite for
    a stage without work. `sensitivities` (quantities, resources): the share of each resource in the time of
    the default less its share in the quantity's own time. Where the times of stages are known, launches in
    different stages are different resources.
    """

    ratios: Array
    sensitivities: Array

    @classmethod
    def fit(
        cls, work: pd.DataFrame, reference: pd.Series, stage_times: pd.DataFrame | None = None
    ) -> WorkModel:
        """`work`, `reference` and `stage_times` as in `DeviceMap`."""
        configurations = [name for name in reference.index if SEPARATOR not in name]
        seconds = np.exp(-reference[configurations])  # in units of the time of the default
        seconds[DEFAULT] = 1.0
        work = work.loc[seconds.index]
        times = (
            _from_totals(work, seconds) if stage_times is None else _from_stages(work, seconds, stage_times)
        )
        whole = times.loc[DEFAULT]
        ratios, sensitivities = [], []
        for quantity in reference.index:
            configuration, _, stage = quantity.partition(SEPARATOR)
            used = times.loc[configuration]
            if stage:
                used = used.where(used.index.get_level_values(0) == stage, 0.0)
            ratios.append(_log(whole.sum()) - _log(used.sum()))
            sensitivities.append(_shares(whole) - _shares(used))
        table = pd.DataFrame(sensitivities)
        if stage_times is None:  # a resource costs the same in every stage
            table = table.T.groupby(level=1).sum().T
        return cls(np.array(ratios), table.to_numpy())


def _from_totals(work: pd.DataFrame, seconds: pd.Series) -> pd.DataFrame:
    """The time of each (stage, resource) in each configuration; a resource costs the same in every stage."""
    resources = work.columns.get_level_values(1)
    total = work.T.groupby(resources).sum().T
    costs = pd.Series(_costs(total, seconds), total.columns)
    return work * costs[resources].to_numpy()


def _from_stages(work: pd.DataFrame, seconds: pd.Series, stage_times: pd.DataFrame) -> pd.DataFrame:
    """The same, with the measured times of stages; the remaining time is that of the other resources."""
    times = stage_times.loc[seconds.index]
    parts = []
    for stage in dict.fromkeys(work.columns.get_level_values(0)):
        units = work.loc[:, [stage]]
        measured = times[stage] if stage in times else seconds - times.sum(axis=1)
        measured = measured.clip(lower=LEAST)
        modelled = units * _costs(units, measured)
        parts.append(modelled.mul(measured / modelled.sum(axis=1).clip(lower=LEAST), axis=0))
    return pd.concat(parts, axis=1)


def _costs(work: pd.DataFrame, seconds: pd.Series) -> Array:
    """Seconds of a unit of each resource, by non-negative least squares of the relative errors."""
    from scipy.optimize import nnls  # slow to import

    scale = work.max().replace(0.0, 1.0)
    relative = (work / scale).div(seconds, axis=0)
    costs, _ = nnls(relative.to_numpy(), np.ones(len(seconds)))
    return np.asarray(costs / scale.to_numpy())


def _shares(times: pd.Series) -> pd.Series:
    total = float(times.sum())
    return times / total if total > 0 else times


def _log(seconds: float) -> float:
    return float(np.log(seconds)) if seconds > 0 else -np.inf
