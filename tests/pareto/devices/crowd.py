"""Made-up devices whose times follow from costs of resources, for tests of predictions."""

from __future__ import annotations

import numpy as np
import pandas as pd

from pareto.devices.device_map import DEFAULT, DeviceMap, log_ratios, stage_quantity

STAGES = ("filter", "track")
RESOURCES = {"filter": "pixels", "track": "points"}
SESSION = ("best",)


def work(count: int = 12, seed: int = 1) -> pd.DataFrame:
    """The default, best and `count` others, each with its own work in two stages."""
    random = np.random.default_rng(seed)
    names = [DEFAULT, "best", *(f"probe-{number:02}" for number in range(count))]
    amounts = np.exp(random.normal(-2.0, 1.0, (len(names), 2)))
    amounts[0] = 1.0, 1.0
    columns = pd.MultiIndex.from_tuples([(stage, RESOURCES[stage]) for stage in STAGES])
    return pd.DataFrame(amounts, index=names, columns=columns)


def seconds(table: pd.DataFrame, costs: np.ndarray) -> pd.Series:
    """Times of the configurations, and of the stages of default and best, on a device with these `costs`."""
    stages = table * costs
    times = stages.sum(axis=1)
    for name in (DEFAULT, *SESSION):
        for stage in STAGES:
            times[stage_quantity(name, stage)] = stages.loc[name, stage].sum()
    return times


def crowd(
    families: int = 6, each: int = 2, spread: float = 0.8, noise: float = 0.0, seed: int = 0
) -> DeviceMap:
    """Devices whose costs differ by `spread` (logarithms) from those of the reference, and from others' of
    their own family by a tenth of that. `noise`: of every ratio.
    """
    random = np.random.default_rng(seed)
    table = work()
    reference = log_ratios(seconds(table, np.ones(2)).to_frame("reference").T).iloc[0]
    rows, names = {}, {}
    for family in range(families):
        centre = random.normal(0.0, spread, 2)
        for member in range(each):
            name = f"device-{family}-{member}"
            rows[name] = seconds(table, np.exp(centre + random.normal(0.0, spread / 10, 2)))
            names[name] = f"family {family}"
    ratios = log_ratios(pd.DataFrame(rows).T)
    ratios += random.normal(0.0, noise, ratios.shape)
    return DeviceMap(ratios, ratios * 0.0 + max(noise, 0.001), pd.Series(names), reference, table)


def after_one_session(device_map: DeviceMap) -> DeviceMap:
    """`device_map` as if each device had measured default and best alone, with their stages."""
    others = [name for name in device_map.configurations if name not in SESSION]
    ratios, errors = device_map.ratios.copy(), device_map.errors.copy()
    ratios[others], errors[others] = np.nan, np.nan
    return DeviceMap(ratios, errors, device_map.families, device_map.reference, device_map.work)
