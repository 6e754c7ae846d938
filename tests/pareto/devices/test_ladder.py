"""Which rung is taken."""

from dataclasses import replace

import numpy as np
import pytest

from pareto.devices import ladder, rungs
from tests.pareto.devices.crowd import SESSION, after_one_session, crowd


def test_the_rung_with_the_least_error_is_taken() -> None:
    result = ladder.climb(crowd(families=6, each=2), SESSION)
    errors = ladder.error_of(result.residuals)
    assert result.rung == "stages"
    assert set(errors.index) == {"power", "stages"}
    assert errors["stages"] < errors["power"]


def test_a_family_is_predicted_by_others_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    device_map = crowd(families=4, each=2)
    taught = []

    def noted(others):
        taught.append(set(others.families))
        return rungs.power(others)

    monkeypatch.setitem(ladder.RUNGS, "power", noted)
    predictions = ladder.held_out(device_map, SESSION, ["power"])
    assert len(taught) == 4
    for fold, families in enumerate(sorted(device_map.families.unique())):
        assert families not in taught[fold]
    assert set(predictions.family) == set(device_map.families)
    assert not predictions.configuration.isin(SESSION).any()


@pytest.mark.slow
def test_few_families_have_no_rung_of_devices_and_many_have() -> None:
    few = ladder.climb(crowd(families=5, each=2), SESSION)
    many = ladder.climb(crowd(families=16, each=1), SESSION)
    assert "devices" not in set(few.residuals.rung)
    assert "devices" in set(many.residuals.rung)


def test_without_probes_stages_decide_where_the_work_is_known() -> None:
    device_map = after_one_session(crowd())
    with_work, without = (
        ladder.climb(device_map, SESSION),
        ladder.climb(replace(device_map, work=None), SESSION),
    )
    assert (with_work.rung, len(with_work.residuals)) == ("stages", 0)
    assert without.rung == "power"
    assert with_work.scale == 1.0


@pytest.mark.slow
def test_intervals_hold_what_they_promise() -> None:
    result = ladder.climb(crowd(families=10, each=3, noise=0.1, seed=3), SESSION)
    residuals = result.residuals[result.residuals.rung == result.rung]
    half = ladder.QUANTILE_95 * result.scale * residuals.deviation
    inside = np.abs(residuals.predicted - residuals.measured) <= half
    assert 0.94 <= inside.mean() <= 0.96


def test_an_interval_is_around_the_mean() -> None:
    belief = rungs.stages(crowd())
    low, high = ladder.interval(belief, 2.0)
    assert (low + high) / 2 == pytest.approx(belief.mean)
    assert high - low == pytest.approx(4 * ladder.QUANTILE_95 * belief.deviation)
