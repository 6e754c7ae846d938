"""The Gaussian process and the expected improvement, against slower ways to the same numbers."""

import numpy as np
import pytest
from scipy.optimize import check_grad
from scipy.stats import norm

from pareto.errors import ObjectiveError
from pareto.fronts.hypervolume import hypervolume
from pareto.search.improvement import expected_improvement
from pareto.surrogates.gaussian import GaussianProcess, Kernel, Likelihood

OWNER = np.array([0, 1, 1])


def some_data(count=40, seed=0):
    rng = np.random.default_rng(seed)
    features = rng.random((count, 3))
    return features, np.sin(4 * features[:, 0]) + features[:, 1] ** 2 + 0.05 * rng.normal(size=count)


def hyperparameters(lengths, stretch, share, noise):
    return np.log([*lengths, stretch, share / (1 - share), noise])


def matern_and_exponential(a, b, lengths, stretch, share):
    """The covariance, one pair at a time; the last two of three columns share a length scale."""
    table = np.empty((len(a), len(b)))
    for i, x in enumerate(a):
        for j, y in enumerate(b):
            steps = [abs(x[0] - y[0]), np.hypot(x[1] - y[1], x[2] - y[2])]
            r = np.sqrt(5 * sum((step / length) ** 2 for step, length in zip(steps, lengths, strict=True)))
            smooth = (1 + r + r**2 / 3) * np.exp(-r)
            blocks = [abs(x[0] - y[0]), (abs(x[1] - y[1]) + abs(x[2] - y[2])) / np.sqrt(2)]
            rough = np.exp(-sum(s / length / stretch for s, length in zip(blocks, lengths, strict=True)))
            table[i, j] = (1 - share) * smooth + share * rough
    return table


def test_the_process_predicts_as_the_textbook_says():
    features, targets = some_data()
    lengths, stretch, share, noise = [0.5, 0.8], 1.7, 0.3, 0.01
    elsewhere = np.random.default_rng(1).random((7, 3))
    process = GaussianProcess(features, targets, OWNER, hyperparameters(lengths, stretch, share, noise))
    posterior = process.at(elsewhere)
    known = matern_and_exponential(features, features, lengths, stretch, share) + noise * np.eye(40)
    cross = matern_and_exponential(features, elsewhere, lengths, stretch, share)
    centred = targets - targets.mean()
    scale = centred @ np.linalg.solve(known, centred) / 40
    variance = 1 - np.einsum("ij,ij->j", cross, np.linalg.solve(known, cross)) + noise
    np.testing.assert_allclose(
        posterior.mean, targets.mean() + cross.T @ np.linalg.solve(known, centred), rtol=1e-8
    )
    np.testing.assert_allclose(posterior.spread, np.sqrt(scale * variance), rtol=1e-8)


def test_two_values_of_a_category_are_as_far_apart_as_the_ends_of_an_axis():
    kernel = Kernel(hyperparameters([0.5, 0.5], 1.7, 0.3, 0.01), OWNER)
    ends, values = [[0.0, 0, 0], [1.0, 0, 0]], [[0, 0.5**0.5, 0], [0, 0, 0.5**0.5]]
    axis, category = (kernel(np.array(rows), np.array(rows)) for rows in (ends, values))
    np.testing.assert_allclose(axis, category, rtol=1e-12)


def test_supposing_a_point_is_refitting_with_it():
    features, targets = some_data()
    theta = hyperparameters([0.5, 0.8], 1.7, 0.3, 0.01)
    elsewhere = np.random.default_rng(1).random((6, 3))
    posterior = GaussianProcess(features, targets, OWNER, theta).at(elsewhere)
    before = posterior.spread
    posterior.suppose(2)
    more = np.vstack([features, elsewhere[2]])
    refitted = GaussianProcess(more, np.append(targets, posterior.mean[2]), OWNER, theta).at(elsewhere)
    shrunk, expected = posterior.spread / before, refitted.spread / before
    np.testing.assert_allclose(shrunk / shrunk[0], expected / expected[0], rtol=1e-6)
    assert (shrunk < 1).all()


def test_the_likelihoods_gradient_is_its_slope():
    features, targets = some_data()
    middle, width = np.full(5, -0.5), np.full(5, 2.0)
    likelihood = Likelihood(features, targets, OWNER, middle, width)
    for theta in (hyperparameters([0.5, 0.8], 1.7, 0.3, 0.01), hyperparameters([2.0, 0.1], 0.6, 0.8, 0.3)):
        error = check_grad(lambda t: likelihood(t)[0], lambda t: likelihood(t)[1], theta)
        assert error < 1e-3


def test_the_share_of_the_rough_part_is_learnt():
    rng = np.random.default_rng(3)
    features = rng.random((200, 2))
    smooth = np.sin(4 * features[:, 0]) + features[:, 1]
    steps = np.floor(features[:, 0] * 7) % 3 + (features[:, 1] > 0.4)
    share = {}
    for name, targets in (("smooth", smooth), ("steps", steps)):
        share[name] = GaussianProcess.fit(features, targets, np.array([0, 1]), rng).theta[-2]
    assert share["smooth"] < -2 < 1 < share["steps"]  # logits


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


def test_a_process_foretells_each_target_from_all_others():
    features, targets = some_data()
    theta = hyperparameters([0.5, 0.8], 1.7, 0.3, 0.01)
    process = GaussianProcess(features, targets, OWNER, theta)
    rows = np.zeros(40, dtype=bool)
    rows[[3, 17, 30]] = True
    known = matern_and_exponential(features, features, [0.5, 0.8], 1.7, 0.3) + 0.01 * np.eye(40)
    centred = targets - targets.mean()
    scale = centred @ np.linalg.solve(known, centred) / 40
    densities, surprises = [], []
    for row in np.flatnonzero(rows):
        others = np.arange(40) != row
        solved = np.linalg.solve(known[np.ix_(others, others)], known[others, row])
        variance = scale * (known[row, row] - known[row, others] @ solved)
        densities.append(norm.logpdf(centred[row], solved @ centred[others], np.sqrt(variance)))
        surprises.append((centred[row] - solved @ centred[others]) / np.sqrt(variance))
    assert process.foretells(rows) == pytest.approx(np.mean(densities), rel=1e-6)
    assert process.surprise()[rows] == pytest.approx(surprises, rel=1e-6)
    left_out = np.sqrt(scale / np.diag(np.linalg.inv(known)))
    assert process.doubt() == pytest.approx(np.median(left_out), rel=1e-6)
