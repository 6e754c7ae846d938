"""python -m tests.benchmarks.censoring: what a search loses where measurements beyond the limit end early.

The made-up KinectFusion with limits, rough and smooth. An error beyond its limit is reported in three ways:
in full, as Censored at a bound between the limit and the value, or as that bound as if it were the value.
Prints the regret (see tests.benchmarks.pareto) of each seed, the median and the share of censored
measurements.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from pareto import Censored, Explorer
from tests.benchmarks.pareto_problems import BATCH, NAMES, SEEDS, Problem, kfusion

MARKS = (100, 200)  # evaluations
WAYS: dict[
    str, tuple[bool, Callable[[float], float]]
] = {  # whether measurements end early, the reported value
    "full values": (False, float),
    "censored": (True, Censored),
    "bounds as values": (True, float),
}


def search(problem: Problem, way: str, share: float, seed: int) -> list[int]:
    """Return the indices that a search measures, to the last mark, reported in one of WAYS.

    A bound lies beyond the limit by a random part of what the value does, at most `share` of it.
    """
    early, reported = WAYS[way]
    assert problem.limits is not None
    limit = problem.limits[0]
    parts = np.random.default_rng(0).uniform(0.0, share, len(problem.space))
    limits = dict(zip(NAMES, problem.limits, strict=True))
    explorer = Explorer(problem.space, NAMES, limits, seed=seed)
    indices: list[int] = []
    while len(indices) < MARKS[-1]:
        for proposal in explorer.propose(min(BATCH, MARKS[-1] - len(indices))):
            first, second = problem.values[proposal.index].tolist()
            if first > limit:
                bound = limit + parts[proposal.index] * (first - limit)
                first = reported(bound if early else first)
            explorer.tell([proposal.configuration], [dict(zip(NAMES, (first, second), strict=True))])
            indices.append(proposal.index)
    return indices


def report(seeds: range, share: float = 0.3, limit: float = 0.05) -> None:
    """Print the regrets; bounds lie at most `share` of the way from the `limit` (metres) to the value."""
    for problem in (kfusion(with_limits=True), kfusion(with_limits=True, rough=False)):
        assert problem.limits is not None
        bounds = (limit, problem.limits[1])
        problem = replace(problem, limits=bounds, references={"limits": bounds})
        print(f"{problem.name}, error within {limit:g}, bounds up to {share:g} of the way")
        print(f"  seeds {seeds[0]} to {seeds[-1]}")
        for way in WAYS:
            runs = [search(problem, way, share, seed) for seed in seeds]
            beyond = np.mean([problem.values[run, 0] > limit for run in runs])
            print(f"  {way}: {100 * beyond:.0f} % beyond the limit")
            for mark in MARKS:
                regrets = [problem.regret(run[:mark], "limits") for run in runs]
                each = " ".join(f"{regret:.4f}" for regret in regrets)
                print(f"    after {mark}: median {np.median(regrets):.4f} ({each})", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description="The search with measurements that end early.")
    parser.add_argument("--seeds", type=int, default=len(SEEDS), help="how many (5)")
    parser.add_argument("--share", type=float, default=0.3, help="of the way to the value, at most (0.3)")
    parser.add_argument("--limit", type=float, default=0.05, help="of the error, in metres (0.05)")
    arguments = parser.parse_args()
    os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"))
    report(SEEDS[: arguments.seeds], arguments.share, arguments.limit)


if __name__ == "__main__":
    main()
