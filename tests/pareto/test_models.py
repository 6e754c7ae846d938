"""The Gaussian process and the expected improvement, against slower ways to the same numbers."""

import numpy as np
import pytest
from scipy.optimize import check_grad

from pareto.errors import ObjectiveError
from pareto.gaussian import GaussianProcess, _negative_log_posterior
from pareto.hypervolume import hypervolume
from pareto.improvement import expected_improvement

OWNER = np.array([0, 1, 1])


def some_data(count=40, seed=0):
    rng = np.random.default_rng(seed)
    features = rng.random((count, 3))
    return features, np.sin(4 * features[:, 0]) + features[:, 1] ** 2 + 0.05 * rng.normal(size=count)


def test_the_process_predicts_like_scikit_learns_with_the_same_kernel():
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import Matern

    features, targets = some_data()
    theta = np.log([0.5, 0.8, 0.01])
    ours = GaussianProcess(features, targets, OWNER, theta)
    theirs = GaussianProcessRegressor(Matern([0.5, 0.8, 0.8], nu=2.5), alpha=0.01, optimizer=None)
    theirs.fit(features, targets - targets.mean())
    elsewhere = np.random.default_rng(1).random((7, 3))
    mean, deviation = theirs.predict(elsewhere, return_std=True)
    posterior = ours.at(elsewhere)
    np.testing.assert_allclose(posterior.mean, mean + targets.mean(), rtol=1e-9)
    scale = posterior.spread**2 / (deviation**2 + 0.01)
    np.testing.assert_allclose(
        scale, scale[0], rtol=1e-6
    )  # the signal variance, which scikit-learn leaves at 1


def test_supposing_a_point_is_refitting_with_it():
    features, targets = some_data()
    theta = np.log([0.5, 0.8, 0.01])
    elsewhere = np.random.default_rng(1).random((6, 3))
    posterior = GaussianProcess(features, targets, OWNER, theta).at(elsewhere)
    ratio = posterior.spread.copy()
    posterior.suppose(2)
    posterior.keep(np.array([0, 2, 5]))
    more = np.vstack([features, elsewhere[2]])
    refitted = GaussianProcess(more, np.append(targets, posterior.mean[1]), OWNER, theta).at(
        elsewhere[[0, 2, 5]]
    )
    shrunk = posterior.spread / ratio[[0, 2, 5]]
    expected = refitted.spread / ratio[[0, 2, 5]]
    np.testing.assert_allclose(shrunk / shrunk[0], expected / expected[0], rtol=1e-6)
    assert (shrunk < 1).all()


def test_the_likelihoods_gradient_is_its_slope():
    features, targets = some_data()
    targets = targets - targets.mean()
    for theta in (np.log([0.5, 0.8, 0.01]), np.log([2.0, 0.1, 0.3])):
        error = check_grad(
            lambda t: _negative_log_posterior(t, features, targets, OWNER)[0],
            lambda t: _negative_log_posterior(t, features, targets, OWNER)[1],
            theta,
        )
        assert error < 1e-3


def test_a_fitted_process_sees_which_parameter_matters():
    rng = np.random.default_rng(0)
    features = rng.random((60, 2))
    process = GaussianProcess.fit(features, np.sin(6 * features[:, 0]), np.array([0, 1]), rng)
    posterior = process.at(np.array([[0.3, 0.1], [0.3, 0.9]]))
    np.testing.assert_allclose(posterior.mean, np.sin(1.8), atol=0.02)


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


def test_hypervolume_of_known_areas():
    points = [[1.0, 3.0], [2.0, 1.0], [9.0, 9.0], [np.nan, 0.0]]
    assert hypervolume(points, [4.0, 4.0]) == pytest.approx(7.0)
    assert hypervolume([[2.0], [1.0]], [4.0]) == 3.0
    assert hypervolume([[1.0, 1.0]], [np.e, np.e], log=True) == pytest.approx(1.0)
    assert hypervolume([[3.0, 1.0]], [1.0, 4.0], maximise=[True, False]) == pytest.approx(2.0 * 3.0)
    assert hypervolume([], [1.0, 1.0]) == 0.0
    assert hypervolume([[5.0, 5.0]], [1.0, 1.0]) == 0.0


def test_hypervolume_refuses_what_does_not_fit():
    with pytest.raises(ObjectiveError, match="do not fit"):
        hypervolume([[1.0, 2.0]], [1.0])
    with pytest.raises(ObjectiveError, match="logarithm"):
        hypervolume([[-1.0, 2.0]], [1.0, 3.0], log=True)
