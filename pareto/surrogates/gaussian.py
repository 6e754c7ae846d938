"""Gaussian process regression for a few hundred points: a smooth trend plus a rough remainder.

The covariance is (1 - share) Matern-5/2 + share exponential of the city-block distance, with one length
scale a parameter. The first is what smooth responses look like. The second (the product of Ornstein-
Uhlenbeck kernels, the limit of Mondrian forests: Balog et al. 2016) follows steps and ridges along the
axes, as tree ensembles do; how much of it there is, is learnt like everything else, so nobody has to know
beforehand which kind of response a space has.

Formulas: Rasmussen & Williams 2006, eq. 2.25, 2.26 (prediction), 5.9 (gradient of the likelihood). The
signal variance is maximised in closed form.
"""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular
from scipy.linalg.lapack import dpotri

Array = NDArray[np.float64]

# Priors keep the fit sane on few points; the hyperparameters are, in this order, the logarithms of the
# length scales (the unit cube's size), the rough part's lengths relative to them, the logit of its share,
# and the logarithm of the noise relative to the signal (0.1 %).
LENGTH = (math.log(0.7), 1.2, math.log(0.03), math.log(55.0))  # mean, deviation, least, largest
STRETCH = (0.5, 1.0, -2.0, 4.0)
SHARE = (-1.0, 2.0, -8.0, 6.0)
NOISE = (math.log(1e-3), 2.0, math.log(1e-6), 0.0)
SHARED = 3  # hyperparameters beyond the length scales
SQRT5 = math.sqrt(5.0)


class Kernel:
    """The correlation between rows of features for given hyperparameters."""

    def __init__(self, theta: Array, owner: NDArray[np.int64]) -> None:
        lengths = np.exp(theta[:-3])
        self._smooth = 1.0 / lengths[owner]
        # Two categorical values differ in two columns, by 1/sqrt(2) each: together, city-block distance 1.
        several = np.bincount(owner)[owner] > 1
        self._rough = self._smooth / math.exp(theta[-3]) / np.where(several, math.sqrt(2.0), 1.0)
        self._share = 1.0 / (1.0 + math.exp(-theta[-2]))
        self.noise = math.exp(theta[-1])

    def __call__(self, a: Array, b: Array) -> Array:
        """Return (len(a), len(b)) correlations."""
        squared = _squared_distances(a * self._smooth, b * self._smooth)
        correlation = _matern(squared)
        if self._share > 1e-3:
            correlation *= 1.0 - self._share
            from scipy.spatial.distance import cdist  # slow to import: not by who merely lists the methods

            rough = cdist(a * self._rough, b * self._rough, "cityblock")
            np.negative(rough, out=rough)
            np.exp(rough, out=rough)
            rough *= self._share
            correlation += rough
        return correlation


class GaussianProcess:
    """A fitted process on (n, columns) features; `owner[c]` is the length scale that column c uses."""

    def __init__(self, features: Array, targets: Array, owner: NDArray[np.int64], theta: Array) -> None:
        self.theta = theta
        self.kernel = Kernel(theta, owner)
        self._mean = float(targets.mean())
        self._features, self._targets = features, targets
        correlation = self.kernel(features, features)
        correlation[np.diag_indices_from(correlation)] += self.kernel.noise
        self._lower = cholesky(correlation, lower=True, overwrite_a=True, check_finite=False)
        self._alpha = solve_triangular(
            self._lower, targets - self._mean, lower=True, check_finite=False
        )  # L^-1 y: half of the solve, which prediction needs
        self._scale = max(float(self._alpha @ self._alpha) / len(targets), 1e-12)

    @classmethod
    def fit(
        cls,
        features: Array,
        targets: Array,
        owner: NDArray[np.int64],
        rng: np.random.Generator,
        points: int = 250,
        iterations: int = 30,
    ) -> GaussianProcess:
        """Choose the hyperparameters on at most `points` of the rows, then condition on all of them.

        A constant target gives a flat process. Rows must be finite; at least one is needed.
        """
        from scipy.optimize import minimize  # slow to import, like cdist

        lengths = int(owner.max()) + 1
        mean, deviation, least, largest = np.array([LENGTH] * lengths + [STRETCH, SHARE, NOISE]).T
        if len(targets) < 3 or np.ptp(targets) == 0:
            return cls(features, targets, owner, mean)
        some = rng.permutation(len(targets))[:points]
        likelihood = Likelihood(features[some], targets[some], owner, mean, deviation)
        found = minimize(
            likelihood,
            mean,
            jac=True,
            method="L-BFGS-B",
            bounds=np.stack([least, largest], axis=1),
            options={"maxiter": iterations},
        )
        return cls(features, targets, owner, found.x)

    @cached_property
    def left_out(self) -> tuple[Array, Array]:
        """(n,) mean and (n,) standard deviation of each target, foretold from all others.

        Rasmussen & Williams 2006, eq. 5.10 to 5.12; the hyperparameters stay those of all rows.
        """
        inverse, _ = dpotri(self._lower, lower=1)
        precision = np.diag(inverse)
        weights = solve_triangular(self._lower, self._alpha, lower=True, trans=1, check_finite=False)
        return self._targets - weights / precision, np.sqrt(self._scale / precision)

    def surprise(self) -> Array:
        """Return by how many (n,) standard deviations each target is above what all others foretell."""
        mean, deviation = self.left_out
        return (self._targets - mean) / deviation

    def foretells(self, rows: NDArray[np.bool_]) -> float:
        """Return the mean log density of the targets of `rows`, each foretold from all other rows."""
        _, deviation = self.left_out
        squared = self.surprise()[rows] ** 2
        return float(-0.5 * np.mean(np.log(2.0 * math.pi * deviation[rows] ** 2) + squared))

    def doubt(self) -> float:
        """Return the median standard deviation with which a target is foretold from all others."""
        return float(np.median(self.left_out[1]))

    def at(self, features: Array) -> Posterior:
        """Return the posterior at (n, columns) features."""
        return Posterior(self, features)


class Posterior:
    """What a process says about a fixed list of candidates, and what it would say after further points."""

    def __init__(self, process: GaussianProcess, features: Array) -> None:
        self._kernel = process.kernel
        self._scale = process._scale
        self._features = features
        self._solved = solve_triangular(
            process._lower,
            self._kernel(process._features, features),
            lower=True,
            overwrite_b=True,
            check_finite=False,
        )
        self.mean: Array = process._mean + process._alpha @ self._solved
        self._variance = np.maximum(1.0 - np.einsum("ij,ij->j", self._solved, self._solved), 1e-12)

    @property
    def spread(self) -> Array:
        """The standard deviation of a measurement at each candidate: the function's and the noise's.

        The noise counts, because much of it is not noise: what a process cannot follow is different
        at each point yet the same at each visit, and a lucky point is a find.
        """
        return np.sqrt(self._scale * (self._variance + self._kernel.noise))

    def suppose(self, candidate: int) -> None:
        """Condition on candidate number `candidate` turning out exactly as expected.

        Means stay as they are; the spread shrinks around it (kriging believer).
        """
        prior = self._kernel(self._features[candidate : candidate + 1], self._features)[0]
        covariance = prior - self._solved[:, candidate] @ self._solved
        row = covariance / math.sqrt(self._variance[candidate] + self._kernel.noise)
        self._solved = np.concatenate([self._solved, row[None]])
        self._variance = np.maximum(self._variance - row**2, 1e-12)


class Likelihood:
    """The negative logarithm of the hyperparameters' posterior density, and its gradient."""

    def __init__(
        self, features: Array, targets: Array, owner: NDArray[np.int64], mean: Array, deviation: Array
    ) -> None:
        centred = targets - targets.mean()
        self._targets = centred / max(float(centred.std()), 1e-12)
        self._mean, self._deviation = mean, deviation
        count = len(targets)
        squared = np.zeros((int(owner.max()) + 1, count, count))
        for column, parameter in enumerate(owner):
            squared[parameter] += (features[:, column, None] - features[:, column]) ** 2
        self._squared = squared.reshape(len(squared), -1)  # (parameters, count^2) distances
        self._distance = np.sqrt(self._squared)

    def __call__(self, theta: Array) -> tuple[float, Array]:
        count, targets = len(self._targets), self._targets
        inverse_lengths = np.exp(-theta[:-3])
        stretch, share = math.exp(theta[-3]), 1.0 / (1.0 + math.exp(-theta[-2]))
        noise = math.exp(theta[-1])
        r = SQRT5 * np.sqrt(inverse_lengths**2 @ self._squared)
        decay = np.exp(-r)
        smooth = decay * (1.0 + r + r * r / 3.0)
        blocks = (inverse_lengths / stretch) @ self._distance
        rough = np.exp(-blocks)
        correlation = ((1.0 - share) * smooth + share * rough).reshape(count, count)
        correlation[np.diag_indices_from(correlation)] += noise
        lower = cholesky(correlation, lower=True, overwrite_a=True, check_finite=False)
        half_log_det = np.log(np.diag(lower)).sum()
        inverse, _ = dpotri(lower, lower=1)
        inverse = np.tril(inverse) + np.tril(inverse, -1).T
        weights = inverse @ targets
        scale = max(float(targets @ weights) / count, 1e-12)
        prior = (theta - self._mean) / self._deviation
        value = 0.5 * count * math.log(scale) + half_log_det + 0.5 * float(prior @ prior)

        outer = (inverse - np.outer(weights, weights) / scale).ravel()  # dL/dK, twice
        gradient = prior / self._deviation
        # d smooth / d log length = 5/3 (1 + r) exp(-r) (difference / length)^2, with r already times sqrt(5)
        slope = outer * ((1.0 - share) * (5.0 / 3.0)) * (1.0 + r) * decay
        gradient[:-3] += 0.5 * inverse_lengths**2 * (self._squared @ slope)
        slope = outer * share * rough
        gradient[:-3] += 0.5 * inverse_lengths / stretch * (self._distance @ slope)
        gradient[-3] += 0.5 * float(slope @ blocks)
        gradient[-2] += 0.5 * share * (1.0 - share) * float(outer @ (rough - smooth))
        gradient[-1] += 0.5 * noise * float(outer[:: count + 1].sum())
        return value, gradient


def _squared_distances(a: Array, b: Array) -> Array:
    squared = (a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1) - 2.0 * (a @ b.T)
    return np.maximum(squared, 0.0, out=squared)


def _matern(squared: Array) -> Array:
    r = np.sqrt(squared)
    r *= SQRT5
    correlation = np.exp(-r)
    correlation *= 1.0 + r + r * r / 3.0
    return correlation
