"""Prints the table of networks in docs/research/coverage.md: python -m docs.tools.network_votes

CROWDS honest crowds for each cell take about a minute.
"""

import math
from collections.abc import Iterable, Sequence

from crowd.results.figures import statistics
from docs.tools.coverage import table
from tests.crowd import test_networks as networks

CROWDS, SIZES = 10, (6, 29, 83)


def logs_of(crowd: Sequence[networks.Model], quorum: int) -> tuple[float, float]:
    """The logarithms of `crowd`'s headline and median."""
    weighed = networks.weighed(crowd, quorum)
    ratios = [math.exp(each.log) for each in weighed.figures]
    median = statistics.geometric_median(ratios, weighed.weights.tolist())
    return statistics.mean_of(weighed.figures, weighed.weights).log, math.log(median)


def cell(attack: str, models: int, hostile: int) -> str:
    """The headline with a quorum of 1 (no votes), with votes, and the median with votes, over CROWDS."""
    attacked = [
        networks.ATTACKS[attack](crowd, hostile, networks.BOUNDS[1])
        for crowd in networks.crowds(models, CROWDS)
    ]
    before = statistics.geometric_mean([math.exp(logs_of(crowd, 1)[0]) for crowd in attacked])
    after, median = (
        statistics.geometric_mean([math.exp(log) for log in column])
        for column in zip(*(logs_of(crowd, networks.QUORUM) for crowd in attacked), strict=True)
    )
    return f"{before:.1f}, {after:.1f}, {median:.1f}"


def limit(models: int, hostile: int) -> str:
    """The largest headline that `hostile` networks may reach."""
    groups = hostile / networks.QUORUM
    honest = sum(map(networks.headline, networks.crowds(models, CROWDS))) / CROWDS
    return f"{math.exp(honest + groups / (models + groups) * networks.BOUNDS[1]):.1f}"


def rows() -> Iterable[list[str]]:
    for hostile in networks.HOSTILE:
        yield ["limit", str(hostile), *(limit(models, hostile) for models in SIZES)]
    for attack in networks.ATTACKS:
        for hostile in networks.HOSTILE:
            yield [attack, str(hostile), *(cell(attack, models, hostile) for models in SIZES)]


if __name__ == "__main__":
    table("Networks", ("attack", "networks", *(f"{models} models" for models in SIZES)), rows())
