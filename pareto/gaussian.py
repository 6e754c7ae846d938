"""Gaussian process regression for a few hundred points: Matern-5/2, one length scale a parameter.

Formulas: Rasmussen & Williams 2006, eq. 2.25, 2.26 (prediction), 5.9 (gradient of the likelihood). The
signal variance is maximised in closed form, so the search runs over length scales and relative noise only.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular
from scipy.linalg.lapack import dpotri
from scipy.optimize import minimize

Array = NDArray[np.float64]

# Log-normal priors keep the fit sane on few points: the unit cube's size for lengths, 1 % noise.
LENGTH_PRIOR, LENGTH_SPREAD = math.log(0.7), 1.2
NOISE_PRIOR, NOISE_SPREAD = math.log(1e-3), 2.0
LENGTH_BOUNDS = (math.log(0.03), math.log(30.0))
NOISE_BOUNDS = (math.log(1e-6), math.log(1.0))
SQRT5 = math.sqrt(5.0)


class GaussianProcess:
    """A fitted process on (n, columns) features; `owner[c]` is the length scale that column c uses."""

    def __init__(self, features: Array, targets: Array, owner: NDArray[np.int64], theta: Array) -> None:
        self._owner = owner
        self._theta = theta
        self._mean = float(targets.mean())
        self._features = features
        self._scaled = features / np.exp(theta[:-1])[owner]
        correlation = _matern(_squared_distances(self._scaled, self._scaled))
        correlation[np.diag_indices_from(correlation)] += math.exp(theta[-1])
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
        """Choose length scales and noise on at most `points` of the rows, then condition on all of them.

        A constant target gives a flat process. Rows must be finite; at least one is needed.
        """
        lengths = int(owner.max()) + 1
        start = np.array([LENGTH_PRIOR] * lengths + [NOISE_PRIOR])
        if len(targets) < 3 or np.ptp(targets) == 0:
            return cls(features, targets, owner, start)
        some = rng.permutation(len(targets))[:points]
        x, y = features[some], targets[some] - targets.mean()
        y = y / max(float(y.std()), 1e-12)
        bounds = [LENGTH_BOUNDS] * lengths + [NOISE_BOUNDS]
        found = minimize(
            _negative_log_posterior,
            start,
            args=(x, y, owner),
            jac=True,
            method="L-BFGS-B",
            bounds=bounds,
            options={"maxiter": iterations},
        )
        return cls(features, targets, owner, found.x)

    def at(self, features: Array) -> Posterior:
        """Return the posterior at (n, columns) features."""
        return Posterior(self, features)


class Posterior:
    """What a process says about a fixed list of candidates, and what it would say after further points."""

    def __init__(self, process: GaussianProcess, features: Array) -> None:
        self._noise = math.exp(process._theta[-1])
        self._scale = process._scale
        self._scaled = features / np.exp(process._theta[:-1])[process._owner]
        cross = _matern(_squared_distances(process._scaled, self._scaled))
        self._solved = solve_triangular(
            process._lower, cross, lower=True, overwrite_b=True, check_finite=False
        )
        self.mean: Array = process._mean + process._alpha @ self._solved
        self._variance = np.maximum(1.0 - np.einsum("ij,ij->j", self._solved, self._solved), 1e-12)

    @property
    def spread(self) -> Array:
        """The standard deviation of a measurement at each candidate: the function's and the noise's.

        The noise counts, because much of it is not noise: what a smooth process cannot follow is different
        at each point yet the same at each visit, and a lucky point is a find.
        """
        return np.sqrt(self._scale * (self._variance + self._noise))

    def suppose(self, candidate: int) -> None:
        """Condition on candidate number `candidate` turning out exactly as expected.

        Means stay as they are; the spread shrinks around it (kriging believer).
        """
        prior = _matern(_squared_distances(self._scaled[candidate : candidate + 1], self._scaled))[0]
        covariance = prior - self._solved[:, candidate] @ self._solved
        row = covariance / math.sqrt(self._variance[candidate] + self._noise)
        self._solved = np.concatenate([self._solved, row[None]])
        self._variance = np.maximum(self._variance - row**2, 1e-12)

    def keep(self, candidates: NDArray[np.integer]) -> None:
        """Forget all other candidates; `candidates` number the present ones."""
        self._scaled, self._solved = self._scaled[candidates], self._solved[:, candidates]
        self.mean, self._variance = self.mean[candidates], self._variance[candidates]


def _squared_distances(a: Array, b: Array) -> Array:
    squared = (a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1) - 2.0 * (a @ b.T)
    return np.maximum(squared, 0.0, out=squared)


def _matern(squared: Array) -> Array:
    r = np.sqrt(squared)
    r *= SQRT5
    correlation = np.exp(-r)
    correlation *= 1.0 + r + r * r / 3.0
    return correlation


def _negative_log_posterior(
    theta: Array, features: Array, targets: Array, owner: NDArray[np.int64]
) -> tuple[float, Array]:
    count = len(targets)
    noise = math.exp(theta[-1])
    scaled = features / np.exp(theta[:-1])[owner]
    r = np.sqrt(5.0 * _squared_distances(scaled, scaled))
    decay = np.exp(-r)
    correlation = decay * (1.0 + r + r * r / 3.0)
    correlation[np.diag_indices_from(correlation)] += noise
    lower = cholesky(correlation, lower=True, overwrite_a=True, check_finite=False)
    half_log_det = np.log(np.diag(lower)).sum()
    inverse, _ = dpotri(lower, lower=1)
    inverse = np.tril(inverse) + np.tril(inverse, -1).T
    weights = inverse @ targets
    scale = max(float(targets @ weights) / count, 1e-12)
    prior = (theta - LENGTH_PRIOR) / LENGTH_SPREAD
    prior[-1] = (theta[-1] - NOISE_PRIOR) / NOISE_SPREAD
    value = 0.5 * count * math.log(scale) + half_log_det + 0.5 * float(prior @ prior)

    outer = inverse - np.outer(weights, weights) / scale  # dL/dK, twice
    # dk/d(log length) = 5/3 (1 + r) exp(-r) (difference / length)^2, with r already times sqrt(5)
    slope = outer * ((5.0 / 3.0) * decay * (1.0 + r))
    per_column = slope.sum(axis=1) @ scaled**2 - np.einsum("ic,ic->c", scaled, slope @ scaled)
    gradient = np.empty_like(theta)
    gradient[:-1] = np.bincount(owner, weights=per_column, minlength=len(theta) - 1)
    gradient[-1] = 0.5 * noise * float(np.trace(outer))
    gradient[:-1] += prior[:-1] / LENGTH_SPREAD
    gradient[-1] += prior[-1] / NOISE_SPREAD
    return value, gradient
