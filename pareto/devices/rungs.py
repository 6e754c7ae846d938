"""The ladder: three ways to learn a belief about a device from measured ones.

1. `power`: the reference's ratios to a power, times a factor.
2. `stages`: in addition, every resource (a pixel filtered, a voxel fused, a launch, ...) may cost more or
   less than on the reference device, as the times of stages show.
3. `devices`: in addition, the remaining covariance between devices and within families, learned from the
   devices and shrunk towards the rung below. It needs many families.

Each is a Gaussian belief, so all give intervals, accept any measurements, and rank further ones by their
gain.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pareto.devices.device_map import SEPARATOR, DeviceMap
from pareto.devices.prediction import Belief, Observation, Places
from pareto.devices.work import WorkModel

Array = NDArray[np.float64]

MOST_FITTED = 200  # devices with most measurements: more do not change the result
LEAST_FAMILIES = 16  # of the rung `devices`
LEAST_ERROR = 0.02  # of a measured ratio: the difference between sessions
# Prior standard deviations of the logarithms, from sixteen test devices (docs/research/device-map.md), and
# the standard deviation of their own logarithms.
GUESSES = {"power": 0.1, "factor": 0.1, "cost": 0.4, "rest": 0.08, "stage": 0.1, "alike": 0.1}
REST_WITHOUT_WORK = 0.2  # in place of "rest", "cost" and "alike"
ALIKE = 1.0  # distance of logarithms of work over which ratios correlate
SURENESS, FARTHEST = 1.0, float(np.log(4.0))  # limits the influence of a single unusual device
STRENGTH = 20.0  # weight of the rung below, in devices
ROUNDS = 5  # of expectation and maximisation


@dataclass(frozen=True)
class Components:
    """The components of a belief's covariance: (quantities, quantities) matrices, by the name of a guess."""

    mean: Array
    parts: dict[str, Array]

    def belief(self, logs: Array) -> Belief:
        """With these logarithms of the standard deviations, in the order of `parts`."""
        weights = np.exp(2.0 * logs)
        covariance = sum(weight * part for weight, part in zip(weights, self.parts.values(), strict=True))
        return Belief(self.mean, np.asarray(covariance))


def observations(known: DeviceMap) -> list[Observation]:
    """The observations of each device of `known`, in the order of its rows."""
    values, errors = known.ratios.to_numpy(float), known.errors.to_numpy(float)
    per_device = []
    for row, error in zip(values, errors, strict=True):
        places = np.flatnonzero(~np.isnan(row))
        per_device.append(Observation(places, row[places], np.maximum(error[places], LEAST_ERROR)))
    return per_device


def power(known: DeviceMap) -> Belief:
    """The first rung, from the devices of `known`; it does not use the times of stages."""
    return _fitted(_components(known, None), known)


def stages(known: DeviceMap) -> Belief:
    """The second rung, from the devices of `known`. Raises ValueError where their work is unknown."""
    if known.work is None:
        raise ValueError("the work of the configurations is unknown: only the other rungs can be used")
    return _fitted(_components(known, WorkModel.fit(known.work, known.reference, known.stage_times)), known)


def devices(known: DeviceMap) -> Belief:
    """The third rung, from the devices of `known`."""
    below = stages(known) if known.work is not None else power(known)
    chosen = _most_measured(known)
    seen = observations(chosen)
    mean, covariance = below.mean, below.covariance
    for _ in range(ROUNDS):
        beliefs = [Belief(mean, covariance).after(one) for one in seen]
        means = np.array([belief.mean for belief in beliefs])
        weights = _weights(chosen)
        share = weights.sum() / (weights.sum() + 1.0)
        mean = (1 - share) * below.mean + share * np.average(means, axis=0, weights=weights)
        spread = means - mean
        moments = np.einsum("d,dq,dr->qr", weights, spread, spread)
        moments += np.einsum("d,dqr->qr", weights, np.array([belief.covariance for belief in beliefs]))
        covariance = (STRENGTH * below.covariance + moments) / (STRENGTH + weights.sum())
    return Belief(mean, covariance, _relation(Belief(mean, covariance), known))


RUNGS: dict[str, Callable[[DeviceMap], Belief]] = {"power": power, "stages": stages, "devices": devices}


def _components(known: DeviceMap, work: WorkModel | None) -> Components:
    """Without `work`, those of the first rung: there stages are independent of everything else."""
    whole = np.array([SEPARATOR not in name for name in known.ratios.columns])
    reference = known.reference.to_numpy(float)
    unknown = np.isnan(reference)
    modelled = np.full(len(reference), reference[whole].mean()) if work is None else work.ratios
    mean = np.where(unknown, np.where(np.isfinite(modelled), modelled, 0.0), reference)
    shape = mean * whole if work is None else mean
    parts = {
        "power": np.outer(shape, shape),
        "factor": np.outer(whole, whole).astype(float),
        "rest": np.diag(whole.astype(float)),
        # Quantities that the reference did not measure are less certain.
        "stage": np.diag(np.where(whole, 0.0, np.where(unknown, 9.0, 1.0))),
    }
    if work is not None:
        parts["cost"] = work.sensitivities @ work.sensitivities.T
        parts["alike"] = np.outer(whole, whole) * _alikeness(known)
    return Components(mean, parts)


def _alikeness(known: DeviceMap) -> Array:
    """The similarity of the work of quantities, (quantities, quantities), 1 for the same."""
    assert known.work is not None
    names = [name.partition(SEPARATOR)[0] for name in known.ratios.columns]
    resources = known.work.columns.get_level_values(1)
    logs = np.log1p(known.work.T.groupby(resources).sum().T.loc[names].to_numpy())
    apart = ((logs[:, None] - logs[None]) ** 2).sum(axis=2)
    return np.asarray(np.exp(-apart / (2 * ALIKE**2)))


def _fitted(components: Components, known: DeviceMap) -> Belief:
    """The belief with the most probable standard deviations (with a prior around GUESSES)."""
    rest = {} if "cost" in components.parts else {"rest": REST_WITHOUT_WORK}
    guesses = np.log([(GUESSES | rest)[name] for name in components.parts])
    batches = _batches(_most_measured(known))
    if not batches:
        return components.belief(guesses)

    def badness(logs: Array) -> tuple[float, Array]:
        belief = components.belief(logs)
        slopes = np.zeros_like(belief.covariance)
        value = sum(batch.badness(belief, slopes) for batch in batches)
        each = np.array([(slopes * part).sum() for part in components.parts.values()])
        apart = (logs - guesses) / SURENESS
        return float(value + apart @ apart / 2), 2.0 * np.exp(2.0 * logs) * each + apart / SURENESS

    from scipy.optimize import minimize  # slow to import

    near = [(guess - FARTHEST, guess + FARTHEST) for guess in guesses]
    settings: dict[str, Any] = {"method": "L-BFGS-B", "bounds": near, "options": {"maxiter": 30}}
    return components.belief(minimize(badness, guesses, jac=True, **settings).x)


@dataclass(frozen=True)
class _Batch:
    """Devices that measured the same quantities, those at `places`: `values` and `errors` (devices, places)
    and `weights` (devices,).
    """

    places: Places
    values: Array
    errors: Array
    weights: Array

    def badness(self, belief: Belief, slopes: Array) -> float:
        """The weighted negative log likelihood; its derivative by the covariance is added to `slopes`.

        Rasmussen & Williams 2006, eq. 5.8 and 5.9.
        """
        block = np.ix_(self.places, self.places)
        covariance = belief.covariance[block] + self.errors[:, :, None] ** 2 * np.eye(len(self.places))
        inverse = np.linalg.inv(covariance)
        left = self.values - belief.mean[self.places]
        scaled = np.einsum("dij,dj->di", inverse, left)
        slopes[block] += 0.5 * np.tensordot(self.weights, inverse, 1)
        slopes[block] -= 0.5 * (scaled * self.weights[:, None]).T @ scaled
        each = (left * scaled).sum(axis=1) + np.linalg.slogdet(covariance)[1]
        return float(0.5 * self.weights @ each)


def _batches(known: DeviceMap) -> list[_Batch]:
    seen, weights = observations(known), _weights(known)
    groups: dict[bytes, list[int]] = {}
    for number, one in enumerate(seen):
        groups.setdefault(one.places.tobytes(), []).append(number)
    return [
        _Batch(
            seen[group[0]].places,
            np.array([seen[number].values for number in group]),
            np.array([seen[number].errors for number in group]),
            weights[group],
        )
        for group in groups.values()
    ]


def _most_measured(known: DeviceMap) -> DeviceMap:
    counts = known.ratios.notna().sum(axis=1).sort_values(ascending=False, kind="stable")
    return known.of(counts.index[counts > 0][:MOST_FITTED])


def _weights(known: DeviceMap) -> Array:
    """Each of a family of n devices counts 1 / sqrt(n): similar devices are worth less than others."""
    sizes = known.families.map(known.families.value_counts())
    return np.asarray(1.0 / np.sqrt(sizes.to_numpy(float)))


def _relation(belief: Belief, known: DeviceMap) -> float:
    """The correlation within a family beyond what all devices share: 0 to 0.95.

    The mean product of the standardised residuals of two devices of a family in one quantity.
    """
    left = (known.ratios - belief.mean) / np.sqrt(
        belief.deviation**2 + known.errors.clip(lower=LEAST_ERROR) ** 2
    )
    products, pairs = 0.0, 0
    for _, rows in left.groupby(known.families):
        count, total = rows.notna().sum(), rows.sum()
        products += float((total**2 - (rows**2).sum()).sum())
        pairs += int((count * (count - 1)).sum())
    return float(np.clip(products / pairs, 0.0, 0.95)) if pairs else 0.0
