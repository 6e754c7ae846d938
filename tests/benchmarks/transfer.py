"""python -m tests.benchmarks.transfer: how many measurements another device's data saves, on two real GPUs.

The convolution kernel's times on an A100 and an A4000, one objective: the time on the target. Each search is
run alone and with a prior from the other GPU: what a search of 200 measurements found there, its whole table,
that table turned upside down, and with its times shuffled, which says nothing. FRONTRUNNER_DATA names the
data. Writes var/benchmarks/transfer.json and prints tables.
"""

from __future__ import annotations

import json
import os
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pareto import Explorer
from pareto.devices.correlation import correlate, ranks_of_best
from tests.benchmarks.pareto_problems import ROOT, Problem, convolution

DEVICES = ("A100", "A4000")
SEEDS = tuple(range(600, 620))
MARKS = (20, 40, 80, 120)
WITHIN = (0.5, 0.25, 0.1)  # of the best time
BATCH = 10
SOURCE_BUDGET, SOURCE_SEED = 200, 1


@dataclass(frozen=True)
class Outcome:
    """Means over seeds: time over the best one, minus 1, at MARKS; measurements until WITHIN.

    A search that does not get there within the budget counts one more than its budget. `area` is the mean
    logarithm of the best time so far over the best there is, over all measurements.
    """

    target: str
    prior: str
    excess: dict[int, float]
    needed: dict[float, float]
    area: float
    areas: list[float]


def search(
    problem: Problem, times: NDArray[np.float64], seed: int, budget: int, prior: Any = ()
) -> list[int]:
    """Return the indices that one search measured, in order; `times` (points,) has NaN where one fails."""
    explorer = Explorer(problem.space, ("time",), seed=seed, prior=prior)
    while len(explorer.history.results) < budget:
        proposals = explorer.propose(min(BATCH, budget - len(explorer.history.results)))
        explorer.tell(
            [proposal.configuration for proposal in proposals],
            [_values(times[proposal.index]) for proposal in proposals],
        )
    return list(explorer.history.results)


def excess(times: NDArray[np.float64], indices: list[int]) -> NDArray[np.float64]:
    """Return, after each measurement, how much slower the best so far is than the best there is.

    As long as nothing ran, the slowest time there is stands in.
    """
    filled = np.where(np.isnan(times[indices]), np.nanmax(times), times[indices])
    return np.minimum.accumulate(filled) / np.nanmin(times) - 1


def priors(problem: Problem, times: NDArray[np.float64]) -> dict[str, list[Any]]:
    """Return what is known of the source whose `times` are given, by name."""
    everything = np.flatnonzero(problem.space.allowed_grid).tolist()
    explored = search(problem, times, SOURCE_SEED, SOURCE_BUDGET)
    return {
        "none": [],
        f"{SOURCE_BUDGET} measurements": _pairs(problem, times, explored),
        "whole table": _pairs(problem, times, everything),
        "upside down": _pairs(problem, 1 / times, everything),
        "shuffled": _pairs(problem, _shuffled(times), everything),
    }


def outcome(
    problem: Problem, target: str, times: NDArray[np.float64], name: str, prior: list[Any]
) -> Outcome:
    """Search with every seed and return the means."""
    curves = [excess(times, search(problem, times, seed, MARKS[-1], prior)) for seed in SEEDS]
    areas = [float(np.log1p(curve).mean()) for curve in curves]
    return Outcome(
        target,
        name,
        {mark: float(np.mean([curve[mark - 1] for curve in curves])) for mark in MARKS},
        {share: float(np.mean([_needed(curve, share) for curve in curves])) for share in WITHIN},
        float(np.mean(areas)),
        areas,
    )


def warm_start(data: Path) -> list[Outcome]:
    """Search for each device's best with every prior from the other."""
    problem = convolution(data / "dse" / "convolution", with_constraints=True)
    outcomes = []
    for target in (1, 0):
        for name, prior in priors(problem, problem.values[:, 1 - target]).items():
            times = problem.values[:, target]
            outcomes.append(outcome(problem, DEVICES[target], times, name, prior))
            sys.stdout.write(line(outcomes[-1]) + "\n")
            sys.stdout.flush()
    return outcomes


def line(row: Outcome) -> str:
    """Return one row of the printed table."""
    cells = "".join(f"{value:8.3f}" for value in row.excess.values())
    needed = "".join(f"{value:8.0f}" for value in row.needed.values())
    return f"{row.target:<6} {row.prior:<18}{cells}{needed}{row.area:8.3f}"


def main() -> None:
    """Run everything, print it and write it."""
    if not (data := os.environ.get("FRONTRUNNER_DATA")):
        sys.exit("FRONTRUNNER_DATA is not set: it names the folder with dse/convolution")
    problem = convolution(Path(data) / "dse" / "convolution", with_constraints=True)
    first, second = problem.values.T
    alike = correlate(first, second, log=True)
    ranks = ranks_of_best(problem.values.T)
    sys.stdout.write(f"{DEVICES[0]} and {DEVICES[1]}: {alike}\n")
    sys.stdout.write(f"the best of one is number {ranks[0, 1]:g} and {ranks[1, 0]:g} on the other\n")
    marks = "".join(f"{mark:>8}" for mark in MARKS)
    within = "".join(f"{f'{100 * share:g} %':>8}" for share in WITHIN)
    sys.stdout.write(f"over the best after, measurements until within, mean of {len(SEEDS)} seeds\n")
    sys.stdout.write(f"{'target':<6} {'prior':<18}{marks}{within}    area\n")
    folder = ROOT / "var" / "benchmarks"
    folder.mkdir(parents=True, exist_ok=True)
    outcomes = [asdict(each) for each in warm_start(Path(data))]
    (folder / "transfer.json").write_text(json.dumps(outcomes, indent=2) + "\n")


def _needed(curve: NDArray[np.float64], share: float) -> int:
    return int(np.argmax(curve <= share)) + 1 if curve[-1] <= share else len(curve) + 1


def _values(time: float) -> dict[str, float] | None:
    return None if np.isnan(time) else {"time": float(time)}


def _shuffled(times: NDArray[np.float64]) -> NDArray[np.float64]:
    ran = np.flatnonzero(~np.isnan(times))
    mixed = times.copy()
    mixed[ran] = np.random.default_rng(0).permutation(times[ran])
    return mixed


def _pairs(problem: Problem, times: NDArray[np.float64], indices: list[int]) -> list[Any]:
    return [(problem.space.decode(index), _values(times[index])) for index in indices]


if __name__ == "__main__":
    main()
