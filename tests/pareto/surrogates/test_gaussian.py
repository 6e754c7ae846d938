"""The Gaussian process against slower ways to the same numbers."""

import numpy as np
import pytest
from scipy.optimize import check_grad
from scipy.stats import norm

from pareto.surrogates.gaussian import SUPPOSED, GaussianProcess, Kernel, Likelihood

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


FEATURES, TARGETS = some_data()
THETA = hyperparameters([0.5, 0.8], 1.7, 0.3, 0.01)
ELSEWHERE = np.random.default_rng(1).random((7, 3))


def test_the_process_predicts_as_the_textbook_says():
    lengths, stretch, share, noise = [0.5, 0.8], 1.7, 0.3, 0.01
    process = GaussianProcess(FEATURES, TARGETS, OWNER, hyperparameters(lengths, stretch, share, noise))
    posterior = process.at(ELSEWHERE)
    matrix = matern_and_exponential(FEATURES, FEATURES, lengths, stretch, share) + noise * np.eye(40)
    cross = matern_and_exponential(FEATURES, ELSEWHERE, lengths, stretch, share)
    centred = TARGETS - TARGETS.mean()
    scale = centred @ np.linalg.solve(matrix, centred) / 40
    variance = 1 - np.einsum("ij,ij->j", cross, np.linalg.solve(matrix, cross)) + noise
    np.testing.assert_allclose(
        posterior.mean, TARGETS.mean() + cross.T @ np.linalg.solve(matrix, centred), rtol=1e-8
    )
    np.testing.assert_allclose(posterior.spread, np.sqrt(scale * variance), rtol=1e-8)


def test_two_values_of_a_category_are_as_far_apart_as_the_ends_of_an_axis():
    kernel = Kernel(hyperparameters([0.5, 0.5], 1.7, 0.3, 0.01), OWNER)
    ends, values = [[0.0, 0, 0], [1.0, 0, 0]], [[0, 0.5**0.5, 0], [0, 0, 0.5**0.5]]
    axis, category = (kernel(np.array(rows), np.array(rows)) for rows in (ends, values))
    np.testing.assert_allclose(axis, category, rtol=1e-12)


@pytest.mark.parametrize("supposed", [[2], [*range(2 * SUPPOSED + 1)]])
def test_supposing_points_is_refitting_with_them(supposed):
    """One, and more than there is room for."""
    elsewhere = np.random.default_rng(1).random((2 * SUPPOSED + 3, 3))
    posterior = GaussianProcess(FEATURES, TARGETS, OWNER, THETA).at(elsewhere)
    before = posterior.spread
    for candidate in supposed:
        posterior.suppose(candidate)
    more = np.vstack([FEATURES, elsewhere[supposed]])
    refitted = GaussianProcess(more, np.append(TARGETS, posterior.mean[supposed]), OWNER, THETA).at(elsewhere)
    shrunk, expected = posterior.spread / before, refitted.spread / before
    np.testing.assert_allclose(shrunk / shrunk[-1], expected / expected[-1], rtol=1e-6)
    assert (shrunk < 1).all()


def test_the_likelihoods_gradient_is_its_slope():
    middle, width = np.full(5, -0.5), np.full(5, 2.0)
    likelihood = Likelihood(FEATURES, TARGETS, OWNER, middle, width)
    for theta in (hyperparameters([0.5, 0.8], 1.7, 0.3, 0.01), hyperparameters([2.0, 0.1], 0.6, 0.8, 0.3)):
        error = check_grad(lambda t: likelihood(t)[0], lambda t: likelihood(t)[1], theta)
        assert error < 1e-3


def test_the_share_of_the_rough_part_is_learned():
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


def test_a_process_predicts_each_target_from_all_others():
    process = GaussianProcess(FEATURES, TARGETS, OWNER, THETA)
    rows = np.zeros(40, dtype=bool)
    rows[[3, 17, 30]] = True
    matrix = matern_and_exponential(FEATURES, FEATURES, [0.5, 0.8], 1.7, 0.3) + 0.01 * np.eye(40)
    centred = TARGETS - TARGETS.mean()
    scale = centred @ np.linalg.solve(matrix, centred) / 40
    densities, excesses, means, deviations = [], [], [], []
    for row in np.flatnonzero(rows):
        others = np.arange(40) != row
        solved = np.linalg.solve(matrix[np.ix_(others, others)], matrix[others, row])
        variance = scale * (matrix[row, row] - matrix[row, others] @ solved)
        densities.append(norm.logpdf(centred[row], solved @ centred[others], np.sqrt(variance)))
        excesses.append((centred[row] - solved @ centred[others]) / np.sqrt(variance))
        means.append(TARGETS.mean() + solved @ centred[others])
        deviations.append(np.sqrt(variance))
    mean, deviation = process.left_out()
    np.testing.assert_allclose(mean[rows], means, rtol=1e-6)
    np.testing.assert_allclose(deviation[rows], deviations, rtol=1e-6)
    assert process.log_density(rows) == pytest.approx(np.mean(densities), rel=1e-6)
    assert process.excess()[rows] == pytest.approx(excesses, rel=1e-6)


def dense_truth(features, targets, theta_parts, counts, variance):
    """Posterior of the values without noise, by dense matrices: (mean, deviation)."""
    lengths, stretch, share, nugget = theta_parts
    signal = matern_and_exponential(features, features, lengths, stretch, share)
    centred = targets - targets.mean()
    eye = np.eye(len(targets))
    scale = centred @ np.linalg.solve(signal + nugget * eye, centred) / len(targets)
    noise = min(variance / scale, 1.0)
    latent = scale * (signal + max(nugget - noise, 0.0) * eye)  # the roughness is part of the truth
    measured = latent + np.diag(np.minimum(variance / counts, scale))
    weights = np.linalg.solve(measured, latent).T
    covariance = latent - weights @ latent
    return targets.mean() + weights @ centred, np.sqrt(np.diag(covariance))


@pytest.mark.parametrize("variance", [0.0005, 0.003, 0.2])
def test_the_truth_behind_repeated_measurements_is_their_posterior_without_noise(variance):
    """Noise of a part of the nugget, of more than it, and of more than the signal."""
    parts = [0.5, 0.8], 1.7, 0.3, 0.01
    counts = np.random.default_rng(2).integers(1, 5, len(TARGETS))
    process = GaussianProcess(FEATURES, TARGETS, OWNER, hyperparameters(*parts), variance, variance / counts)
    expected, deviation = dense_truth(FEATURES, TARGETS, parts, counts, variance)
    mean, left = process.truth(variance / counts)
    np.testing.assert_allclose(mean, expected, rtol=1e-8)
    np.testing.assert_allclose(left, deviation, rtol=1e-6)
    assert (left <= np.sqrt(variance / counts) * (1 + 1e-12)).all()


def test_without_noise_repeats_change_nothing_and_the_truth_is_what_was_measured():
    counts = np.random.default_rng(2).integers(1, 5, len(TARGETS))
    plain = GaussianProcess(FEATURES, TARGETS, OWNER, THETA)
    same = GaussianProcess(FEATURES, TARGETS, OWNER, THETA, 0.0, 0.0 / counts)
    np.testing.assert_array_equal(plain.at(ELSEWHERE).mean, same.at(ELSEWHERE).mean)
    np.testing.assert_array_equal(plain.at(ELSEWHERE).spread, same.at(ELSEWHERE).spread)
    mean, deviation = same.truth(0.0 / counts)
    np.testing.assert_array_equal(mean, TARGETS)
    assert not deviation.any()


def test_a_point_measured_often_weighs_more_and_noise_hides_part_of_what_a_measurement_tells():
    theta = hyperparameters([0.5, 0.8], 1.7, 0.3, 0.05)
    variance = 0.05 * GaussianProcess(FEATURES, TARGETS, OWNER, theta)._scale
    once, often = np.ones(40, dtype=np.int64), np.ones(40, dtype=np.int64)
    often[7] = 50
    one, many = (
        GaussianProcess(FEATURES, TARGETS, OWNER, theta, variance, variance / n) for n in (once, often)
    )
    at_it = FEATURES[7:8]
    assert abs(many.at(at_it).mean[0] - TARGETS[7]) < 0.3 * abs(one.at(at_it).mean[0] - TARGETS[7])
    rough = GaussianProcess(FEATURES, TARGETS, OWNER, theta).at(ELSEWHERE).spread
    assert (one.at(ELSEWHERE).spread < rough).all()
    unknown = one.at(ELSEWHERE)._variance + one.roughness
    expected = np.sqrt(one._scale * unknown**2 / (unknown + one.noise))
    np.testing.assert_allclose(one.at(ELSEWHERE).spread, expected)
