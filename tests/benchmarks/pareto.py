"""python -m tests.benchmarks.pareto: how near each search method comes to the true front, and how fast.

Regret is 1 - HV / HV* of the logarithms of the objectives, HV* of the exhaustive front; lower is better.
Writes var/benchmarks/pareto.json and prints tables. Takes a few minutes; FRONTRUNNER_DATA adds BlackScholes.
"""

from __future__ import annotations

import json
import os
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pareto import Explorer, Scenario, Space
from pareto.evaluation import EvaluationError, from_table
from pareto.forest import Forest
from pareto.front import nondominated
from pareto.hypervolume import hypervolume
from pareto.methods import METHODS
from tests.benchmarks.synthetic_kfusion import evaluate

ROOT = Path(__file__).parents[2]
MARKS = (50, 100, 200, 500)
SEEDS = 3
NAMES = ("first", "second")


@dataclass(frozen=True)
class Problem:
    """A space with the values (points, 2) of all its points, NaN where one fails, and what the user knows."""

    name: str
    space: Space
    values: NDArray[np.float64]
    limits: dict[str, float] | None
    reference: NDArray[np.float64]

    def regret(self, indices: list[int]) -> float:
        """Return how much of the exhaustive front's hypervolume `indices` leave uncovered."""
        best = self.values[nondominated(self.values)]
        return 1 - self._volume(self.values[indices]) / self._volume(best)

    def _volume(self, values: NDArray[np.float64]) -> float:
        return hypervolume(values, self.reference, log=True)


def synthetic(with_limits: bool) -> Problem:
    """The made-up KinectFusion; limits are 5 cm and the default's runtime, which also bound the score."""
    space = Space.load(ROOT / "pareto" / "spaces" / "kfusion.json")
    values = evaluate(space, np.arange(len(space)))
    bounds = np.array([0.05, values[space.encode(space.default), 1]])
    limits = dict(zip(NAMES, bounds.tolist(), strict=True)) if with_limits else None
    return Problem("kfusion, " + ("limits" if with_limits else "no limits"), space, values, limits, bounds)


def black_scholes(folder: Path) -> Problem:
    """The exhaustive table: validity is learnt from failures, no limits are given."""
    scenario = Scenario.load(folder / "BlackScholes_scenario.json")
    table = folder / "BlackScholes_exhaustive_search_data.csv"
    look_up = from_table(table, scenario.space, scenario.objectives, scenario.feasible)
    values = np.full((len(scenario.space), 2), np.nan)
    for index in range(len(values)):
        try:
            values[index] = list(look_up(scenario.space.decode(index)).values())
        except EvaluationError:
            continue
    return Problem("BlackScholes", scenario.space, values, None, np.nanmax(values, axis=0))


def search(problem: Problem, method: str, seed: int) -> tuple[list[float], float]:
    """Return the regret at MARKS and the CPU milliseconds a suggestion of one search in batches of 20."""
    explorer = Explorer(problem.space, NAMES, problem.limits, seed=seed, method=method)
    asked: list[int] = []
    regrets: list[float] = []
    spent = 0.0
    for mark in MARKS:
        while len(asked) < mark:
            begun = time.process_time()
            proposals = explorer.propose(min(20, mark - len(asked)))
            spent += time.process_time() - begun
            if not proposals:
                break
            rows = problem.values[[proposal.index for proposal in proposals]]
            results = [None if np.isnan(row).any() else dict(zip(NAMES, row, strict=True)) for row in rows]
            explorer.tell([proposal.configuration for proposal in proposals], results)
            asked += [proposal.index for proposal in proposals]
        regrets.append(problem.regret(asked))
    return regrets, 1000 * spent / len(asked)


def predict_all() -> dict[str, float]:
    """Time a forest of 100 trees over 1,800,000 points, by corner differences and by scikit-learn."""
    space = Space.load(ROOT / "pareto" / "spaces" / "kfusion.json")
    rng = np.random.default_rng(0)
    known = rng.choice(len(space), 3000, replace=False)
    targets = np.log(evaluate(space, known)[:, 1])
    forest = Forest.grow(space.codes(known), targets, space.shape, seed=0, extra=False)
    begun = time.perf_counter()
    ours = forest.predict_grid()
    middle = time.perf_counter()
    forest.predict_grid_with_spread()
    after = time.perf_counter()
    theirs = forest.predict(space.codes(np.arange(len(space))))
    ended = time.perf_counter()
    return {
        "mean_seconds": middle - begun,
        "mean_and_spread_seconds": after - middle,
        "scikit_learn_seconds": ended - after,
        "largest_difference": float(np.abs(ours - theirs).max()),
    }


def main() -> None:
    """Run everything, print it and write it."""
    problems = [synthetic(with_limits=True), synthetic(with_limits=False)]
    if data := os.environ.get("FRONTRUNNER_DATA"):
        problems.append(black_scholes(Path(data) / "dse" / "hypermapper"))
    else:
        sys.stdout.write("FRONTRUNNER_DATA is not set: BlackScholes is left out\n")
    results: list[dict[str, object]] = []
    header = "".join(f"{mark:>8}" for mark in MARKS)
    sys.stdout.write(f"regret, mean of {SEEDS} seeds, after{header}  CPU ms a suggestion\n")
    for problem in problems:
        for method in METHODS:
            runs = [search(problem, method, seed) for seed in range(SEEDS)]
            regret = np.mean([regrets for regrets, _ in runs], axis=0)
            cost = float(np.mean([milliseconds for _, milliseconds in runs]))
            results.append(
                {"problem": problem.name, "method": method, "regret": dict(zip(MARKS, regret, strict=True))}
                | {"seeds": SEEDS, "cpu_ms_a_suggestion": cost}
            )
            cells = "".join(f"{value:8.4f}" for value in regret)
            sys.stdout.write(f"{problem.name:<20} {method:<11}{cells}  {cost:8.1f}\n")
            sys.stdout.flush()
    prediction = predict_all()
    sys.stdout.write("1,800,000 points, 100 trees: " + json.dumps(prediction, indent=None) + "\n")
    folder = ROOT / "var" / "benchmarks"
    folder.mkdir(parents=True, exist_ok=True)
    answer = {"regret": results, "prediction": prediction}
    (folder / "pareto.json").write_text(json.dumps(answer, indent=2) + "\n")


if __name__ == "__main__":
    main()
