"""Costs of resources from times and exact work."""

import numpy as np
import pytest

from pareto.devices.device_map import log_ratios
from pareto.devices.work import WorkModel
from tests.pareto.devices.crowd import seconds, work


def ratios(costs: np.ndarray):
    return log_ratios(seconds(work(), costs).to_frame("device").T).iloc[0]


def test_ratios_of_configurations_and_stages_follow_from_the_costs() -> None:
    reference = ratios(np.array([0.5, 3.0]))
    stages = [":" in name for name in reference.index]
    found = WorkModel.fit(work(), reference.mask(stages))  # the times of stages are not reported
    assert found.ratios == pytest.approx(reference.to_numpy(), abs=1e-6)


def test_sensitivities_are_the_derivatives_by_the_logarithms_of_costs() -> None:
    costs, step = np.array([0.5, 3.0]), 1e-5
    model = WorkModel.fit(work(), ratios(costs))
    # Resources are in alphabetical order: pixels, points.
    for resource in range(2):
        changed = costs.copy()
        changed[resource] *= np.exp(step)
        slope = (ratios(changed) - ratios(costs)) / step
        assert model.sensitivities[:, resource] == pytest.approx(slope.to_numpy(), abs=1e-3)


def test_a_stage_without_work_takes_no_time() -> None:
    table = work()
    table.loc["best", ("track", "points")] = 0.0
    reference = ratios(np.ones(2))
    found = WorkModel.fit(table, reference)
    assert found.ratios[list(reference.index).index("best:track")] == np.inf
