"""A search over two reals of any value finds the optimum of Branin's function."""

import math

import pytest

from pareto import Explorer
from tests.builders.spaces import space_of

OPTIMUM = 0.39788736
SPACE = space_of(x1=(-5, 10), x2=(0, 15))


def branin(point):
    """Branin 1972, with the usual constants: three equal optima."""
    x, y = point["x1"], point["x2"]
    bend = y - 5.1 / (4 * math.pi**2) * x**2 + 5 / math.pi * x - 6
    return bend**2 + 10 * (1 - 1 / (8 * math.pi)) * math.cos(x) + 10


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.exhaustive) for seed in (1, 2))])
def test_a_hundred_and_twenty_measurements_come_within_a_thousandth(seed):
    explorer = Explorer(SPACE, ["cost"], seed=seed)
    for _ in range(24):
        batch = explorer.ask(5)
        explorer.tell(batch, [{"cost": branin(point)} for point in batch])
    [(_, best)] = explorer.front()
    assert OPTIMUM - 1e-6 <= best["cost"] < 1.001 * OPTIMUM
