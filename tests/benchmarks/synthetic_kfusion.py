"""A made-up KinectFusion over its whole space: smooth costs, a tracking basin that is lost, and roughness."""

import numpy as np
from numpy.typing import NDArray

from pareto.spaces.space import Space

Array = NDArray[np.float64]

# Standard deviations, of logarithms, of what depends on every parameter at once. Of 471 configurations of
# real KinectFusion, measured on one machine, those that kept track had errors of which a smooth process left
# 2.2 % unexplained; of this one's errors at the same points it leaves that much at a little under 2 %.
# Repetitions gave the same error to the last digit; in the runtime nothing was seen beyond what they vary by.
ERROR, STRAIN, RUNTIME = 0.02, 0.02, 0.01


def evaluate(space: Space, indices: NDArray[np.int64], seed: int = 0, rough: bool = True) -> Array:
    """Return (n, 2) columns ate_max (m) and runtime (s a frame) of the kfusion space's `indices`.

    Shaped like the real thing, without its numbers: integration grows with the cube of the resolution,
    raycasting with the image and the steps of the ray, tracking with iterations until the threshold ends
    them; tracking is lost where the motion between tracked frames exceeds the basin of convergence.
    `rough` adds what depends on every parameter at once, as lost and found again tracking does: no search can
    learn it, and part of the front are the luckiest points of all.
    """
    codes = space.codes(indices)
    column = {
        parameter.name: np.array(parameter.values, dtype=float)[codes[:, axis]]
        for axis, parameter in enumerate(space.parameters)
    }
    volume, ratio, mu = column["volume_resolution"], column["compute_size_ratio"], column["mu"]
    fine, middle, coarse = (column[f"pyramid_iterations_{level}"] for level in ("fine", "middle", "coarse"))
    integration, tracking, threshold = (
        column["integration_rate"],
        column["tracking_rate"],
        column["icp_threshold"],
    )
    amount = 1.0 if rough else 0.0
    voxel, pixels = 4.8 / volume, 1.0 / ratio**2

    needed = 1.0 + 1.5 * np.maximum(0.0, -np.log10(threshold))
    spent = [
        np.minimum(iterations, needed * (1 + 0.15 * level))
        for level, iterations in enumerate([fine, middle, coarse])
    ]
    tracking_time = 0.0034 * pixels * (spent[0] + spent[1] / 4 + spent[2] / 16) / tracking
    integration_time = 0.054 * (volume / 256) ** 3 / integration * (0.9 + 0.4 * mu)
    steps = 0.3 + 0.35 * (0.1 / mu) ** 0.8 + 0.3 * np.sqrt(mu / voxel / 5.3)
    raycast_time = 0.28 * pixels * steps * (volume / 256) ** 0.35
    runtime = 0.033 * pixels + tracking_time + integration_time + raycast_time + 0.001

    basin = 0.018 * (1 + 0.5 * np.sqrt(coarse) + 0.3 * np.sqrt(middle) + 0.15 * np.sqrt(fine)) / ratio**0.45
    basin *= 1 - 0.4 * np.exp(-needed / 1.5)
    motion = 0.011 * tracking * (1 + 0.02 * integration)
    strain = (
        motion / basin + 0.25 * np.maximum(0.0, 1.3 - mu / voxel) + 0.004 * integration * (0.4 / (mu + 0.1))
    )
    strain *= np.exp(
        0.10 * roughness(codes, seed, keep=(0, 1, 7)) + amount * STRAIN * roughness(codes, seed + 1)
    )
    resolution = np.hypot(0.10 * voxel, 0.0012 * ratio**1.2)
    drift = 0.0006 * (integration - 1) ** 0.7 + 0.006 * np.maximum(0.0, strain) ** 2 + 0.02 * mu**1.5
    error = np.sqrt(resolution**2 + drift**2) * np.exp(amount * ERROR * roughness(codes, seed + 2))
    lost = 1.0 / (1.0 + np.exp(-(strain - 1.0) / 0.02))
    ate = error ** (1 - lost) * (0.25 * strain) ** lost
    return np.stack([ate, runtime * np.exp(amount * RUNTIME * roughness(codes, seed + 3))], axis=1)


def roughness(codes: NDArray[np.int64], seed: int, keep: tuple[int, ...] | None = None) -> Array:
    """Return about standard normal noise that depends on the codes (of the axes in `keep`) alone."""
    rng = np.random.default_rng(seed)
    axes = range(codes.shape[1]) if keep is None else keep
    mixed = np.zeros(len(codes), dtype=np.uint64)
    for axis in axes:
        mixed = (mixed ^ codes[:, axis].astype(np.uint64)) * np.uint64(int(rng.integers(2**62)) * 2 + 1)
        mixed ^= mixed >> np.uint64(29)
    halves = [
        ((mixed >> np.uint64(shift)) & np.uint64(0xFFFF)).astype(float) / 0xFFFF for shift in (0, 16, 32, 48)
    ]
    return (sum(halves) - 2.0) * np.sqrt(3.0)
