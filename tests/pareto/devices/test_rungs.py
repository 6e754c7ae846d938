"""What each rung of the ladder learns."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from pareto.devices import rungs
from pareto.devices.device_map import DeviceMap
from pareto.devices.prediction import Belief
from tests.pareto.devices.crowd import after_one_session, crowd


def errors(belief: Belief, target: DeviceMap) -> np.ndarray:
    """Absolute errors (logarithms) of the configurations that no session measures, after one session."""
    probes = [name.startswith("probe") for name in target.ratios.columns]
    rows = []
    for index, seen in enumerate(rungs.observations(after_one_session(target))):
        after = belief.after(seen)
        rows.append(np.abs(after.mean - target.ratios.iloc[index].to_numpy())[probes])
    return np.concatenate(rows)


def test_stage_times_tell_the_costs_before_any_probe() -> None:
    source, target = crowd(seed=1), crowd(seed=2)
    power, stages = rungs.power(source), rungs.stages(source)
    assert np.median(errors(stages, target)) < 0.4 * np.median(errors(power, target))


def test_without_any_device_the_guesses_decide() -> None:
    target = crowd(seed=3, spread=0.3)
    nothing = target.of(target.ratios.index[:0])
    power, stages = rungs.power(nothing), rungs.stages(nothing)
    assert power.mean == pytest.approx(target.reference.to_numpy())
    assert np.median(errors(stages, target)) < np.median(errors(power, target))


def test_stages_need_the_work() -> None:
    with pytest.raises(ValueError, match="the work of the configurations is unknown"):
        rungs.stages(replace(crowd(), work=None))


@pytest.mark.slow
def test_devices_learn_what_the_work_does_not_explain() -> None:
    quirk = pd.Series(0.0, index=crowd().ratios.columns)
    quirk["probe-03"], quirk["probe-07"] = 0.8, -0.6

    def strange(seed: int) -> DeviceMap:
        device_map = crowd(families=20, each=2, spread=0.3, seed=seed)
        return replace(device_map, ratios=device_map.ratios + quirk)

    stages, devices = rungs.stages(strange(4)), rungs.devices(strange(4))
    assert np.max(errors(devices, strange(5))) < 0.5 * np.max(errors(stages, strange(5)))


@pytest.mark.slow
def test_relatives_are_alike_where_families_are() -> None:
    alike = rungs.devices(crowd(families=18, each=3, spread=0.8, seed=6))
    device_map = crowd(families=18, each=3, spread=0.8, seed=7)
    shuffled = replace(
        device_map,
        families=pd.Series(
            np.random.default_rng(0).permutation(device_map.families), device_map.families.index
        ),
    )
    assert alike.relation > 0.7
    assert rungs.devices(shuffled).relation < 0.4


def test_measurements_narrow_intervals() -> None:
    device_map = crowd(noise=0.02)
    belief = rungs.stages(device_map)
    after = belief.after(rungs.observations(after_one_session(device_map))[0])
    assert (after.deviation <= belief.deviation + 1e-9).all()
    assert after.deviation.mean() < 0.6 * belief.deviation.mean()
