"""python -m tests.benchmarks.intervals: how often intervals of recommended points hold the truth.

Three kinds of noise: equal for all values; growing as values fall; little, but in some measurements another
program slows the second objective down. The truth is what many measurements would give, by the mean of their
logarithms. A cell of the table pools all recommended points of all seeds, and both objectives.
"""

from __future__ import annotations

import argparse
import os
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pareto import Explorer
from tests.benchmarks.pareto_problems import BATCH, NAMES, Problem, kernel, kfusion, results_of

Array = NDArray[np.float64]

MARKS = (60, 140, 500)  # evaluations
SEEDS = range(950, 955)  # never looked at while the intervals were developed


@dataclass(frozen=True)
class Noise:
    """Standard deviations of logarithms at the largest and at the least value, and bursts.

    A share `burst` of all measurements has its second objective multiplied by `slower`.
    """

    name: str
    largest: float
    least: float
    burst: float = 0.0
    slower: float = 1.0

    def expected(self, values: Array) -> Array:
        """Return (n, 2) expected values of what measures `values` (n, 2)."""
        return values * [1.0, self.slower**self.burst]

    def measurements(self, problem: Problem, indices: list[int], rng: np.random.Generator) -> Array:
        """Return one (n, 2) measurement of each of `indices`."""
        logarithms = np.log(problem.values)
        low, high = np.nanmin(logarithms, axis=0), np.nanmax(logarithms, axis=0)
        share = (logarithms[indices] - low) / (high - low)
        deviation = self.least + (self.largest - self.least) * share
        bursts = rng.random(len(indices)) < self.burst
        slowed = np.stack([np.ones(len(indices)), np.where(bursts, self.slower, 1.0)], axis=1)
        return problem.values[indices] * slowed * np.exp(deviation * rng.standard_normal(deviation.shape))


NOISES = (
    Noise("equal", 0.05, 0.05),
    Noise("growing", 0.02, 0.10),
    Noise("bursts", 0.02, 0.02, burst=0.1, slower=1.5),
)


def search(problem: Problem, noise: Noise, seed: int, last: int) -> Iterator[tuple[int, Array, Array]]:
    """Search; at each mark yield it, which intervals (points, 2) hold the truth, and half widths."""
    explorer = Explorer(problem.space, NAMES, problem.named_limits, seed=seed)
    rng = np.random.default_rng(seed)
    made = 0
    for mark in (mark for mark in MARKS if mark <= last):
        while made < mark:
            proposals = explorer.propose(min(BATCH, mark - made))
            rows = noise.measurements(problem, [proposal.index for proposal in proposals], rng)
            explorer.tell([proposal.configuration for proposal in proposals], results_of(rows))
            made += len(proposals)
        recommended = explorer.recommended()
        indices = [problem.space.encode(item.configuration) for item in recommended]
        ends = np.array([[item.intervals[name] for name in NAMES] for item in recommended])
        truth = noise.expected(problem.values[indices])
        inside = (ends[:, :, 0] <= truth) & (truth <= ends[:, :, 1])
        yield mark, inside, np.log(ends[:, :, 1] / ends[:, :, 0]) / 2


def report(only: str = "", count: int = len(SEEDS), last: int = MARKS[-1]) -> None:
    """Print a row for each problem whose name contains `only`, kind of noise and mark, from `count` seeds."""
    seeds = range(SEEDS[0], SEEDS[0] + count)
    problems = [kfusion(with_limits=True, rough=False), kernel()]
    print(f"\nintervals of recommended points, seeds {seeds[0]} to {seeds[-1]}")
    print(f"{'':<24}{'noise':<10}{'after':>6}{'points':>8}{'covered':>9}{'least seed':>12}{'half width':>12}")
    for problem in (problem for problem in problems if only in problem.name):
        for noise in NOISES:
            cells = defaultdict(list)
            for seed in seeds:
                for mark, inside, width in search(problem, noise, seed, last):
                    cells[mark].append((inside, width))
            for mark, runs in cells.items():
                inside = np.concatenate([run for run, _ in runs])
                width = np.median(np.concatenate([run for _, run in runs]))
                least = min(run.mean() for run, _ in runs)
                print(
                    f"{problem.name:<24}{noise.name:<10}{mark:>6}{len(inside):>8}{inside.mean():>9.1%}"
                    f"{least:>12.0%}{width:>12.1%}",
                    flush=True,
                )


def main() -> None:
    parser = argparse.ArgumentParser(description="Coverage of the intervals of recommended points.")
    parser.add_argument("--seeds", type=int, default=len(SEEDS), help="how many (5)")
    parser.add_argument("--last", type=int, default=MARKS[-1], help="evaluations, at most (500)")
    parser.add_argument("--only", metavar="TEXT", default="", help="problems whose name contains TEXT")
    arguments = parser.parse_args()
    os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"))
    report(arguments.only, arguments.seeds, arguments.last)


if __name__ == "__main__":
    main()
