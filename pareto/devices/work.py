"""Times from work: what a unit of each resource costs on the reference device.

Time = sum over resources of cost x work. The work of a configuration is known exactly. The costs on the
reference device follow from its times, by non-negative least squares of the relative errors. On a device
whose costs differ by factors exp(d), ratios differ to first order by `sensitivities` @ d.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.optimize import nnls

from pareto.devices.device_map import DEFAULT, SEPARATOR

Array = NDArray[np.float64]


@dataclass(frozen=True)
class WorkModel:
    """`ratios` (quantities,): the logarithms that costs and work give on the reference device, infinite for
    a stage without work. `sensitivities` (quantities, resources): the share of each resource in the time of the
    default less its share in the quantity's own time.
    """

    ratios: Array
    sensitivities: Array

    @classmethod
    def fit(cls, work: pd.DataFrame, reference: pd.Series) -> WorkModel:
        """WORK and REFERENCE as in `DeviceMap`."""
        resources = work.columns.get_level_values(1)
        total = work.T.groupby(resources).sum().T
        configurations = [name for name in reference.index if SEPARATOR not in name]
        seconds = np.exp(-reference[configurations])  # in units of the time of the default
        seconds[DEFAULT] = 1.0
        cost = pd.Series(_costs(total.loc[seconds.index], seconds), total.columns)
        whole = total.loc[DEFAULT] * cost
        ratios, sensitivities = [], []
        for quantity in reference.index:
            configuration, _, stage = quantity.partition(SEPARATOR)
            used = total.loc[configuration] * cost
            if stage:
                of_stage = work.loc[configuration, stage]
                used = (of_stage * cost[of_stage.index]).reindex(total.columns, fill_value=0.0)
            ratios.append(_log(whole.sum()) - _log(used.sum()))
            sensitivities.append(_shares(whole) - _shares(used))
        return cls(np.array(ratios), np.array(sensitivities))


def _costs(work: pd.DataFrame, seconds: pd.Series) -> Array:
    """Seconds of a unit of each resource, none negative, with the least relative errors."""
    scale = work.max().replace(0.0, 1.0)
    relative = (work / scale).div(seconds, axis=0)
    found, _ = nnls(relative.to_numpy(), np.ones(len(seconds)))
    return np.asarray(found / scale.to_numpy())


def _shares(seconds: pd.Series) -> Array:
    total = float(seconds.sum())
    return np.asarray(seconds / total if total > 0 else seconds)


def _log(seconds: float) -> float:
    return float(np.log(seconds)) if seconds > 0 else -np.inf
