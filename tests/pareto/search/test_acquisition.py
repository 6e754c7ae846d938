"""The expected improvement against the mean of many draws."""

import numpy as np
import pytest

from pareto.fronts.hypervolume import hypervolume
from pareto.search.acquisition import expected_improvement


@pytest.mark.slow
@pytest.mark.parametrize("objectives", [1, 2, 3])
def test_expected_improvement_is_the_mean_gain_in_hypervolume(objectives):
    rng = np.random.default_rng(objectives)
    front = rng.random((6, objectives)) * 0.8
    reference = np.full(objectives, 1.0)
    mean, spread = rng.random((4, objectives)) * 0.7, 0.05 + 0.2 * rng.random((4, objectives))
    expected = expected_improvement(mean, spread, front, reference, rng)
    before = hypervolume(front, reference)
    for candidate in range(4):
        draws = mean[candidate] + spread[candidate] * rng.normal(size=(4000, objectives))
        gains = [hypervolume(np.vstack([front, draw]), reference) - before for draw in draws]
        tolerance = 4 * np.std(gains) / np.sqrt(4000) + (
            0.05 * np.mean(gains) + 2e-3 if objectives == 3 else 0
        )
        assert expected[candidate] == pytest.approx(np.mean(gains), abs=tolerance)


def test_points_behind_or_beyond_change_nothing():
    rng = np.random.default_rng(0)
    mean, spread, reference = rng.random((5, 2)), np.full((5, 2), 0.1), np.array([1.0, 1.0])
    front = np.array([[0.2, 0.6], [0.6, 0.2]])
    more = np.vstack([front, [[0.7, 0.7], [0.2, 0.6], [0.05, 1.5]]])
    np.testing.assert_allclose(
        expected_improvement(mean, spread, more, reference, rng),
        expected_improvement(mean, spread, front, reference, rng),
    )
