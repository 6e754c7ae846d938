"""The measurements of several devices as tables: a row for each device, a column for each quantity.

A quantity is a mean time of a frame: that of a configuration, or that of one stage of a configuration. It is
kept as the logarithm of how many times it is shorter than the time of the default on the same device in the
same session. So the speed of a device cancels out; only the ratios of its times remain.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from pareto.errors import ObjectiveError

DEFAULT = "default"
SEPARATOR = ":"  # between the name of a configuration and that of a stage


def stage_quantity(configuration: str, stage: str) -> str:
    """The quantity of one `stage` of `configuration`."""
    return f"{configuration}{SEPARATOR}{stage}"


@dataclass(frozen=True)
class DeviceMap:
    """`ratios` (devices x quantities): log(time of the default / time), NaN where nothing was measured.

    `errors`: their standard errors, of the same shape. `families` (devices): the group of each device, such
    as a maker's chips. `reference` (quantities): the same logarithms on the reference device, NaN where they
    are unknown. `work` (default and configurations x (stage, resource)): how much of each resource a frame
    uses in each stage, in any unit that is the same in one resource; None where it is unknown. `stage_times`
    (default and configurations x stages): times on the reference device, in units of the time of its default;
    None where they are unknown.
    """

    ratios: pd.DataFrame
    errors: pd.DataFrame
    families: pd.Series
    reference: pd.Series
    work: pd.DataFrame | None = None
    stage_times: pd.DataFrame | None = None

    def __post_init__(self) -> None:
        alike = self.errors.index.equals(self.ratios.index) and self.errors.columns.equals(
            self.ratios.columns
        )
        if not alike:
            raise ObjectiveError("errors and ratios must have the same devices and quantities")
        if not self.families.index.equals(self.ratios.index):
            raise ObjectiveError("families must name the family of each device of ratios, in the same order")
        if not self.reference.index.equals(self.ratios.columns):
            raise ObjectiveError("reference must have a value for each quantity of ratios, in the same order")
        unknown = [name for name in self.configurations if np.isnan(self.reference[name])]
        if unknown:
            raise ObjectiveError(f"the reference device did not measure configuration {unknown[0]!r}")
        if np.isinf(self.ratios.to_numpy()).any() or (self.errors.to_numpy() < 0).any():
            raise ObjectiveError("ratios must be finite (NaN: not measured), and errors not negative")

    @property
    def configurations(self) -> list[str]:
        """The quantities that are whole configurations."""
        return [name for name in self.ratios.columns if SEPARATOR not in name]

    def without_families(self, families: Iterable[str]) -> DeviceMap:
        """The map without the devices of `families`."""
        kept = ~self.families.isin(list(families))
        return self.of(self.ratios.index[kept])

    def of(self, devices: pd.Index) -> DeviceMap:
        """The map of only these `devices`."""
        return replace(
            self,
            ratios=self.ratios.loc[devices],
            errors=self.errors.loc[devices],
            families=self.families.loc[devices],
        )


def log_ratios(seconds: pd.DataFrame) -> pd.DataFrame:
    """Logarithms for `ratios` from `seconds` (devices x quantities), which has a column for the default."""
    logs = -np.log(seconds).sub(np.log(seconds[DEFAULT]), axis=0)
    return logs.drop(columns=DEFAULT)
