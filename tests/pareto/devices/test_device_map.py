"""The tables of devices and quantities."""

import numpy as np
import pandas as pd
import pytest

from pareto.devices.device_map import DEFAULT, DeviceMap, log_ratios, stage_quantity
from pareto.errors import ObjectiveError
from tests.pareto.devices.crowd import crowd


def test_ratios_are_logarithms_of_how_many_times_shorter() -> None:
    seconds = pd.DataFrame({DEFAULT: [1.0, 4.0], "best": [0.1, 1.0]}, index=["a", "b"])
    ratios = log_ratios(seconds)
    assert list(ratios.columns) == ["best"]
    assert np.exp(ratios["best"]).tolist() == pytest.approx([10.0, 4.0])


def test_stages_are_no_configurations() -> None:
    device_map = crowd()
    assert stage_quantity("best", "track") in device_map.ratios.columns
    assert stage_quantity("best", "track") not in device_map.configurations
    assert "best" in device_map.configurations


def test_devices_of_a_family_can_be_left_out() -> None:
    device_map = crowd(families=3, each=2)
    left = device_map.without_families(["family 1"])
    assert set(left.families) == {"family 0", "family 2"}
    assert left.errors.index.equals(left.ratios.index)


@pytest.mark.parametrize(
    ("member", "words"),
    [
        ("errors", "errors and ratios must have the same"),
        ("families", "families must name the family"),
        ("reference", "reference must have a value"),
    ],
)
def test_tables_that_do_not_fit_are_refused(member: str, words: str) -> None:
    device_map = crowd()
    members = {name: getattr(device_map, name) for name in ("ratios", "errors", "families", "reference")}
    members[member] = members[member].iloc[1:]
    with pytest.raises(ObjectiveError, match=words):
        DeviceMap(**members)


def test_infinite_ratios_and_unknown_references_are_refused() -> None:
    device_map = crowd()
    infinite = device_map.ratios.copy()
    infinite.iloc[0, 0] = np.inf
    with pytest.raises(ObjectiveError, match="NaN: not measured"):
        DeviceMap(infinite, device_map.errors, device_map.families, device_map.reference)
    with pytest.raises(ObjectiveError, match="did not measure configuration 'best'"):
        DeviceMap(
            device_map.ratios,
            device_map.errors,
            device_map.families,
            device_map.reference.where(device_map.reference.index != "best"),
        )
