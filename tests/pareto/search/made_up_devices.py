"""Two made-up devices: the times of one kernel on both, which agree roughly."""

import numpy as np

from tests.builders.spaces import space_of

SPACE = space_of(
    block=[1, 2, 4, 8, 16, 32, 64, 128],
    tile=range(1, 9),
    unroll=range(1, 9),
    layout=["rows", "columns", "morton"],
)
CODES = SPACE.codes(np.arange(len(SPACE)))


def times(optimum, roughness, seed=0):
    """Seconds of every configuration on a made-up device: a bowl around `optimum`, and roughness."""
    rng = np.random.default_rng(seed)
    bowl = (np.array([0.08, 0.05, 0.03, 0.5]) * (CODES - optimum) ** 2).sum(axis=1)
    return 0.01 * np.exp(bowl + roughness * rng.standard_normal(len(SPACE)))


SOURCE = times([6, 2, 5, 1], 0.2, seed=1)
TARGET = 7.0 * times([5, 3, 5, 1], 0.2, seed=2) ** 0.8


def pairs(values, indices, name="seconds"):
    return [(SPACE.decode(int(index)), {name: float(values[index])}) for index in indices]


def some_of_the_source(values=SOURCE, count=150):
    return pairs(values, np.random.default_rng(3).choice(len(SPACE), count, replace=False))
