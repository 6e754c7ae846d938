"""Which networks are behind figures, and how much each device model counts in the headline for them.

Model names can be invented, and three networks confirm any number of them. So each network has one vote, that
it divides among the models of the headline that it measured. A quorum of votes makes a model full. All models
count alike, but what those that are not full add to the headline is limited by their votes.
"""

import hashlib
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from crowd.records.uncertainty import Estimate
from crowd.results.figures import statistics
from crowd.results.figures.statistics import Unit
from crowd.results.validity.plausibility import WIDEST_BOUNDS, Bounds

# A figure's units: key of the network, log ratio.
UNITS = np.dtype([("network", "<u8"), ("log", "<f8")])
UNKNOWN = 0
FEW = 1 / 3  # of the votes: a larger minority far away may be the honest ones
HALVINGS = 60  # of an interval of log ratios, down to rounding errors


def pack(units: Iterable[Unit]) -> bytes:
    """`units` of a figure as bytes; all unknown networks have one key."""
    return np.array([(_key(unit), unit.log_ratio) for unit in units], UNITS).tobytes()


def _key(unit: Unit) -> int:
    if unit.network is None:
        return UNKNOWN
    return int.from_bytes(hashlib.blake2b(str(unit.network).encode(), digest_size=8).digest(), "big")


@dataclass(frozen=True)
class WeighedModels:
    """The figures of the headline's models with a weight (0 to 1) of each, from so many known `networks`."""

    figures: list[Estimate]
    weights: NDArray[np.float64]
    networks: int


def weigh(models: Sequence[Sequence[tuple[Estimate, bytes]]], bounds: Bounds, quorum: int) -> WeighedModels:
    """The figures and weights of `models`, each one or more estimates with the packed units behind it.

    `bounds`: the possible log ratios. n full models and k < 2 n quorums of other networks: these move the
    headline by at most k / (n + k) of the way to `bounds`, however many models they invent. All weights are 1
    for a `quorum` of 1, and while no network adds more than its vote allows.
    """
    units = [[np.frombuffer(packed, UNITS) for _, packed in model] for model in models]
    keys = [np.unique(np.concatenate([each["network"] for each in model])) for model in units]
    keys = [each if each.size else np.array([UNKNOWN], np.uint64) for each in keys]
    networks, network, measured = np.unique(np.concatenate(keys), return_inverse=True, return_counts=True)
    network_count = int(np.count_nonzero(networks != UNKNOWN))
    if quorum == 1:
        figures = [statistics.mean_of([figure for figure, _ in model]) for model in models]
        near = statistics.within_reach([each.log for each in figures]).tolist()
        figures = [replace(each, log=log) for each, log in zip(figures, near, strict=True)]
        return WeighedModels(figures, np.ones(len(models)), network_count)
    vote_of = dict(zip(networks.tolist(), (1 / measured).tolist(), strict=True))
    figures = [
        statistics.mean_of(
            [_voted(figure, each, vote_of) for (figure, _), each in zip(model, rows, strict=True)]
        )
        for model, rows in zip(models, units, strict=True)
    ]
    votes, model = 1 / measured[network], np.repeat(np.arange(len(models)), [each.size for each in keys])
    fullness = np.bincount(model, votes) / quorum
    logs = _without_far_ones(np.array([each.log for each in figures]), np.minimum(fullness, 1.0))
    weights = _weights(logs, votes / quorum, model, network, fullness, bounds)
    figures = [replace(each, log=log) for each, log in zip(figures, logs.tolist(), strict=True)]
    return WeighedModels(figures, weights, network_count)


def _without_far_ones(logs: NDArray[np.float64], weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """`logs` (n,) within reach of their largest group, unless more than FEW of all `weights` (n,) are beyond
    it: invented models of most of the networks must not set the limits for the honest ones.
    """
    limited = statistics.within_reach(logs, weights)
    return limited if weights[limited != logs].sum() <= FEW * weights.sum() else logs


def _voted(figure: Estimate, units: NDArray[np.void], vote_of: dict[int, float]) -> Estimate:
    """`figure`, in which each of its `units` counts by its network's vote.

    Unchanged if all votes are equal.
    """
    votes = np.array([vote_of[network] for network in units["network"].tolist()])
    if votes.size == 0 or np.ptp(votes) == 0:
        return figure
    return replace(figure, log=float(statistics.robust_mean(units["log"], votes)))


def _weights(
    logs: NDArray[np.float64],
    votes: NDArray[np.float64],
    model: NDArray[np.intp],
    network: NDArray[np.intp],
    fullness: NDArray[np.float64],
    bounds: Bounds,
) -> NDArray[np.float64]:
    """The weight of each model (n,), with which their mean is the headline.

    `votes` (m,) of `network` (m,) for `model` (m,) over the quorum add up to `fullness` (n,). A network pulls
    on the headline with its share of each model that is not full. It pulls no more than a model at `bounds`
    would for the votes that it gave these models.
    """
    low, high = (
        min(bounds[0] if math.isfinite(bounds[0]) else WIDEST_BOUNDS[0], float(logs.min())),
        max(bounds[1] if math.isfinite(bounds[1]) else WIDEST_BOUNDS[1], float(logs.max())),
    )
    full = fullness >= 1 - statistics.TINY
    shares = np.where(full[model], 0.0, votes / fullness[model])
    given = np.where(full[model], 0.0, votes)
    allowed: NDArray[np.float64] = np.bincount(network, given).astype(np.float64)

    def pulls(centre: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """That of each network, and its limit."""
        pull = np.asarray(np.bincount(network, shares * (logs[model] - centre)), dtype=np.float64)
        return pull, allowed * np.where(pull > 0, high - centre, centre - low)

    centre, left, right = float(logs.mean()), float(logs.min()), float(logs.max())
    for _ in range(HALVINGS):
        pulled, limit = pulls(centre)
        if (np.abs(pulled) <= limit + statistics.TINY).all() and math.isclose(centre, logs.mean()):
            return np.ones(len(logs))
        total = (logs[full] - centre).sum() + pulled.clip(-limit, limit).sum()
        left, right = (centre, right) if total > 0 else (left, centre)
        centre = (left + right) / 2
    pulled, limit = pulls(centre)
    kept = np.minimum(1.0, limit / np.maximum(np.abs(pulled), statistics.TINY))
    weights = np.bincount(model, shares * kept[network])
    return np.where(full, 1.0, weights)
