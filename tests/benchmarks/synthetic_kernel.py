"""A made-up GPU kernel generator: mostly categories, cliffs where resources run out, interactions, failures.

Time against energy of one launch over 2,150,400 configurations, of which a sixth cannot be launched.
Nothing here is smooth in more than one parameter: it is what smooth models are worst at.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pareto.spaces.space import Space
from tests.benchmarks.synthetic_kfusion import roughness
from tests.builders.spaces import described, parameter

Array = NDArray[np.float64]

THREADS, REGISTERS, SHARED = 1024, 65536, 98304  # a multiprocessor's
SPACE = Space.from_dict(
    {"name": "synthetic-kernel"}
    | described(
        layout=["row", "column", "tiled", "swizzled"],
        staging=["none", "shared", "registers", "both"],
        schedule=["static", "guided", "split", "stream"],
        arithmetic=["single", "half", "mixed"],
        block_x=[8, 16, 32, 48, 64, 96, 128, 256],
        block_y=[1, 2, 4, 8, 16],
        tile=[1, 2, 3, 4, 8],
        unroll=[1, 2, 4, 8],
        clock=parameter([0.5, 0.7, 0.9, 1.1, 1.3, 1.5, 1.8], default=1.3),
        prefetch=bool,
    )
)


def evaluate(indices: NDArray[np.int64], seed: int = 0) -> Array:
    """Return (n, 2) columns time (ms) and energy (mJ), NaN where the kernel cannot be launched."""
    codes = SPACE.codes(indices)
    rng = np.random.default_rng(seed)
    layout, staging, schedule, arithmetic = codes[:, :4].T
    block_x, block_y, tile, unroll, clock = (
        np.array(parameter.values, dtype=float)[codes[:, axis]]
        for axis, parameter in enumerate(SPACE.parameters[:9])
        if axis >= 4
    )
    prefetch = codes[:, 9]

    threads = block_x * block_y
    width = np.array([4.0, 2.0, 3.0])[arithmetic]  # bytes an element
    in_registers, in_shared = np.isin(staging, (2, 3)), np.isin(staging, (1, 3))
    registers = 24 + 5 * unroll + np.where(in_registers, 7, 2) * tile * width / 4 + 8 * prefetch
    shared = np.where(in_shared, (block_x + 8) * (block_y * tile + 8) * width * (1 + prefetch), 512.0)
    groups = np.minimum.reduce([2 * THREADS // threads, REGISTERS // (registers * threads), SHARED // shared])
    launchable = (threads <= THREADS) & (groups >= 1) & ((layout != 3) | (tile % 2 == 0) | (tile == 1))

    occupancy = np.minimum(1.0, np.maximum(groups, 1) * threads / (2 * THREADS))
    wasted = np.ceil(threads / 32) * 32 / threads
    ragged = np.ceil(4096 / (block_x * tile)) * block_x * tile / 4096
    reuse = np.where(staging == 0, 1.0, np.sqrt(tile) * np.where(staging == 3, 1.5, 1.2))
    coalesced = np.array([1.0, 3.0, 1.4, 1.2])[layout] * np.where(block_x < 32, 32 / block_x, 1.0) ** 0.5
    memory = 1.8 * width / 4 * coalesced / reuse * (1 + 0.15 * (1 - occupancy)) / clock**0.6
    compute = 1.1 * wasted * ragged / clock * np.array([1.0, 0.55, 0.8])[arithmetic]
    compute *= (1 + 0.35 / unroll) * (1 + 0.5 * (occupancy < 0.25))
    hidden = np.where(prefetch == 1, 0.25, 0.6) * (1.2 - occupancy)
    time = np.maximum(memory, compute) + hidden * np.minimum(memory, compute)

    # What no model of resources foresees: how choices get on with each other.
    time *= np.exp(0.18 * rng.normal(size=(4, 4, 4))[layout, staging, schedule])
    time *= np.exp(0.15 * rng.normal(size=(4, 5, 4))[schedule, codes[:, 6], codes[:, 7]])
    time *= np.exp(0.12 * rng.normal(size=(3, 8, 2))[arithmetic, codes[:, 4], prefetch])
    time *= np.exp(0.04 * roughness(codes, seed + 1))
    power = 3 + 30 * clock**2.4 * (0.4 + 0.6 * occupancy) / np.array([1.0, 1.25, 1.1])[arithmetic]
    power *= np.exp(0.10 * rng.normal(size=(4, 4))[schedule, staging] + 0.03 * roughness(codes, seed + 2))
    return np.where(launchable[:, None], np.stack([time, time * power], axis=1), np.nan)
