"""Gaussian process regression for a few hundred points: a smooth trend plus a rough remainder.

The covariance is (1 - share) Matern-5/2 + share exponential of the city-block distance, with one length
scale a parameter. The first models smooth responses. The second (the product of Ornstein-
Uhlenbeck kernels, the limit of Mondrian forests: Balog et al. 2016) follows steps and ridges along the
axes, as tree ensembles do. Its share is learned, too, so the kind of response need not be known in advance.

Formulas: Rasmussen & Williams 2006, eq. 2.25, 2.26 (prediction), 5.9 (gradient of the likelihood). The
signal variance is maximised in closed form.
"""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve, cholesky, solve_triangular
from scipy.linalg.lapack import dpotri

from pareto.surrogates.truncated import truncated_mean

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
BLOCK = 32  # rows of a matrix that are computed at once: they stay in the processor's cache
SUPPOSED = 32  # further rows for which a posterior makes room at once
ROUNDS = 2  # iterations for the expectations of censored targets


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
        # Slow to import, which listing the methods must not cost.
        from scipy.spatial.distance import cdist

        correlation = _squared_distances(a * self._smooth, b * self._smooth)
        rough_a, rough_b = a * self._rough, b * self._rough
        for start in range(0, len(a), BLOCK):
            rows = slice(start, start + BLOCK)
            block = correlation[rows]
            _to_matern(block)
            if self._share > 1e-3:
                block *= 1.0 - self._share
                rough = cdist(rough_a[rows], rough_b, "cityblock")
                np.negative(rough, out=rough)
                np.exp(rough, out=rough)
                rough *= self._share
                block += rough
        return correlation


class GaussianProcess:
    """A fitted process on (n, columns) features; `owner[c]` is the length scale that column c uses.

    The residual variance, its nugget, is roughness (a fixed deviation at each point) or measurement noise
    (different at each visit). `variance` is the noise of one measurement, and the rest is roughness; `errors`
    (n) are the variances of the targets, which may be means.
    """

    def __init__(
        self,
        features: Array,
        targets: Array,
        owner: NDArray[np.int64],
        theta: Array,
        variance: float = 0.0,
        errors: Array | None = None,
    ) -> None:
        self.theta = theta
        self.kernel = Kernel(theta, owner)
        self._mean = float(targets.mean())
        self._features, self.targets = features, targets
        self._owner, self._errors, self._variance = owner, errors, variance
        correlation = self.kernel(features, features)
        nugget = self.kernel.noise
        self._condition(correlation, np.full(len(targets), nugget))
        self._scale = max(float(self._alpha @ self._alpha) / len(targets), 1e-12)
        self.noise = min(variance / self._scale, 1.0)  # of one measurement, relative to the signal
        self.roughness = max(nugget - self.noise, 0.0)
        if errors is not None and self.noise > 0:
            self._condition(correlation, self.roughness + np.minimum(errors / self._scale, 1.0))

    def _condition(self, correlation: Array, diagonal: Array) -> None:
        noisy = correlation.copy()
        noisy[np.diag_indices_from(noisy)] += diagonal
        self._lower = cholesky(noisy, lower=True, overwrite_a=True, check_finite=False)
        self._alpha = solve_triangular(
            self._lower, self.targets - self._mean, lower=True, check_finite=False
        )  # L^-1 y: half of the solve, which prediction needs

    @property
    def nugget(self) -> float:
        """The residual variance: an upper bound of the noise of a measurement."""
        return self._scale * self.kernel.noise

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
        optimum = minimize(
            likelihood,
            mean,
            jac=True,
            method="L-BFGS-B",
            bounds=np.stack([least, largest], axis=1),
            options={"maxiter": iterations},
        )
        return cls(features, targets, owner, optimum.x)

    @cached_property
    def _solved(self) -> tuple[Array, Array]:
        """(n,) C^-1 (y - mean), and the (n,) diagonal of C^-1, of the covariance of the measurements."""
        inverse, _ = dpotri(self._lower, lower=1)
        weights = solve_triangular(self._lower, self._alpha, lower=True, trans=1, check_finite=False)
        return weights, np.diag(inverse)

    def left_out(self) -> tuple[Array, Array]:
        """Return (n,) mean and (n,) standard deviation of each target, predicted from all others.

        Rasmussen & Williams 2006, eq. 5.10 to 5.12; the hyperparameters stay those of all rows.
        """
        weights, precision = self._solved
        return self.targets - weights / precision, np.sqrt(self._scale / precision)

    def excess(self) -> Array:
        """Return by how many (n,) standard deviations each target is above its prediction from all others."""
        mean, deviation = self.left_out()
        return (self.targets - mean) / deviation

    def log_density(self, rows: NDArray[np.bool_]) -> float:
        """Return the mean log density of the targets of `rows`, each predicted from all other rows."""
        _, deviation = self.left_out()
        squared = self.excess()[rows] ** 2
        return float(-0.5 * np.mean(np.log(2.0 * math.pi * deviation[rows] ** 2) + squared))

    def with_censored(self, features: Array, bounds: Array, ceiling: Array) -> GaussianProcess:
        """Return the process that also learned from (m,) `bounds`, at or above which the targets there lie.

        Each is replaced by its conditional expectation: the mean of the normal distribution that is predicted
        there, truncated below the bound (Schmee and Hahn 1979; Hutter, Hoos and Leyton-Brown 2013), at most
        `ceiling` (m). At first this process predicts, then the new one does, ROUNDS times, each point left
        out in turn. The hyperparameters stay: otherwise a plateau of bounds would be learned as a plateau of
        values. The new rows follow those of this process, and count as measured once.
        """
        posterior = self.at(features)
        mean, deviation = posterior.mean, np.sqrt(self._scale * (posterior._variance + self.kernel.noise))
        exact_count = len(self.targets)
        everywhere = np.concatenate([self._features, features])
        errors = self._errors
        if errors is not None:
            errors = np.concatenate([errors, np.full(len(bounds), self._variance)])
        for left in range(ROUNDS, -1, -1):
            expected = np.minimum(truncated_mean(mean, deviation, bounds), ceiling)
            targets = np.concatenate([self.targets, expected])
            process = GaussianProcess(everywhere, targets, self._owner, self.theta, self._variance, errors)
            if left:
                mean, deviation = (column[exact_count:] for column in process.left_out())
        return process

    def truth(self, errors: Array) -> tuple[Array, Array]:
        """Return (n,) posterior mean and (n,) standard deviation of each target without noise.

        The roughness is part of what is predicted; the noise, of variances `errors` (n), is not.
        """
        noise = np.minimum(errors / self._scale, 1.0)
        weights, precision = self._solved
        left = np.maximum(noise - noise**2 * precision, 0.0)
        return self.targets - noise * weights, np.sqrt(self._scale * left)

    def at(self, features: Array) -> Posterior:
        """Return the posterior at (n, columns) features."""
        return Posterior(self, features)


class Posterior:
    """The posterior at a fixed list of candidates, and its update by further points."""

    def __init__(self, process: GaussianProcess, features: Array) -> None:
        self._process = process
        self._features = features
        self._solved = solve_triangular(
            process._lower,
            process.kernel(process._features, features),
            lower=True,
            overwrite_b=True,
            check_finite=False,
        )
        self._room = self._solved
        self.mean: Array = process._mean + process._alpha @ self._solved
        self._variance = np.maximum(1.0 - np.einsum("ij,ij->j", self._solved, self._solved), 1e-12)

    @property
    def spread(self) -> Array:
        """The standard deviation of the change of each candidate's expected value by measuring it.

        It includes the roughness, which a measurement reveals, and not the noise, which hides a part of it.
        """
        unknown = self._variance + self._process.roughness
        spread: Array = np.sqrt(self._process._scale * unknown**2 / (unknown + self._process.noise))
        return spread

    def suppose(self, candidate: int) -> None:
        """Condition on candidate number `candidate` turning out exactly as expected.

        Means stay as they are; the spread shrinks around it (kriging believer).
        """
        process = self._process
        prior = process.kernel(self._features[candidate : candidate + 1], self._features)[0]
        covariance = prior - self._solved[:, candidate] @ self._solved
        row = covariance / math.sqrt(self._variance[candidate] + process.roughness + process.noise)
        self._append(row)
        self._variance = np.maximum(self._variance - row**2, 1e-12)

    def _append(self, row: Array) -> None:
        """Add a row to the solved matrix, which is copied only where its room is used up."""
        count, candidates = self._solved.shape
        if count == len(self._room):
            self._room = np.empty((count + SUPPOSED, candidates), order="F")
            self._room[:count] = self._solved
        self._room[count] = row
        self._solved = self._room[: count + 1]


class Likelihood:
    """The negative logarithm of the hyperparameters' posterior density, and its gradient.

    All matrices are symmetric: of each, one triangle is computed, as a vector of pairs.
    """

    def __init__(
        self, features: Array, targets: Array, owner: NDArray[np.int64], mean: Array, deviation: Array
    ) -> None:
        centred = targets - targets.mean()
        self.targets = centred / max(float(centred.std()), 1e-12)
        self._mean, self._deviation = mean, deviation
        self._below = np.tril_indices(len(targets), -1)
        first, second = self._below
        self._squared = np.zeros((int(owner.max()) + 1, len(first)))  # (parameters, pairs)
        for column, parameter in enumerate(owner):
            self._squared[parameter] += (features[first, column] - features[second, column]) ** 2
        self._distance = np.sqrt(self._squared)

    def __call__(self, theta: Array) -> tuple[float, Array]:
        count, targets = len(self.targets), self.targets
        inverse_lengths = np.exp(-theta[:-3])
        stretch, share = math.exp(theta[-3]), 1.0 / (1.0 + math.exp(-theta[-2]))
        noise = math.exp(theta[-1])
        r = SQRT5 * np.sqrt(inverse_lengths**2 @ self._squared)
        decay = np.exp(-r)
        smooth = decay * (1.0 + r + r * r / 3.0)
        blocks = (inverse_lengths / stretch) @ self._distance
        rough = np.exp(-blocks)
        correlation = np.diag(np.full(count, 1.0 + noise))
        correlation[self._below] = (1.0 - share) * smooth + share * rough
        lower = cholesky(correlation, lower=True, overwrite_a=True, check_finite=False)
        half_log_det = np.log(np.diag(lower)).sum()
        inverse, _ = dpotri(lower, lower=1)
        weights = cho_solve((lower, True), targets, check_finite=False)
        scale = max(float(targets @ weights) / count, 1e-12)
        prior = (theta - self._mean) / self._deviation
        value = 0.5 * count * math.log(scale) + half_log_det + 0.5 * float(prior @ prior)

        first, second = self._below
        outer = inverse[self._below] - weights[first] * weights[second] / scale  # dL/dK of each pair
        gradient = prior / self._deviation
        # d smooth / d log length = 5/3 (1 + r) exp(-r) (difference / length)^2, with r already times sqrt(5)
        slope = outer * ((1.0 - share) * (5.0 / 3.0)) * (1.0 + r) * decay
        gradient[:-3] += inverse_lengths**2 * (self._squared @ slope)
        slope = outer * share * rough
        gradient[:-3] += inverse_lengths / stretch * (self._distance @ slope)
        gradient[-3] += float(slope @ blocks)
        gradient[-2] += share * (1.0 - share) * float(outer @ (rough - smooth))
        gradient[-1] += 0.5 * noise * float((np.diag(inverse) - weights**2 / scale).sum())
        return value, gradient


def _squared_distances(a: Array, b: Array) -> Array:
    squared: Array = (a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1)
    product = a @ b.T
    product *= 2.0
    squared -= product
    return np.maximum(squared, 0.0, out=squared)


def _to_matern(squared: Array) -> None:
    """Replace squared distances by their Matern-5/2 correlations."""
    r = np.sqrt(squared, out=squared)
    r *= SQRT5
    third = r * r
    third /= 3.0
    factor = 1.0 + r
    factor += third
    np.negative(r, out=r)
    np.exp(r, out=r)
    r *= factor
