"""python -m tests.benchmarks.pareto: how near each search comes to the true front, beside other optimisers.

Regret is 1 - HV / HV* of the logarithms of the objectives, HV* of the exhaustive front: lower is better. All
get the same problems and budgets; a point evaluated twice counts twice. Where measurements are noisy, what a
search recommends is judged by the values without noise: the recommended front of ours, the non-dominated
measurements of all others; what it discovered stands beside that. Our seeds are ones that were not looked
at while the methods were developed. The peers live in an environment of their own, made on first use (about
5 GB); their runs are kept there, so that only the first time takes long: about five hours of CPU, of which
nine tenths are Optuna's Gaussian processes, SMAC and HyperMapper (`--cheap` leaves them out). What is kept
is taken up where an earlier run was ended. `--stored` takes of the peers what is kept and runs none; every
row says how many seeds stand behind it. `--fresh` runs peers again, too.

FRONTRUNNER_DATA names a folder of measured tables (BlackScholes, a convolution); without it they are left
out. Writes var/benchmarks/pareto.json and prints tables.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from pareto import Explorer
from pareto.search.methods import DEFAULT, METHODS
from tests.benchmarks import intervals
from tests.benchmarks import pareto_peers as peers
from tests.benchmarks.pareto_problems import BATCH, NAMES, SEEDS, Problem, problems, results_of
from tests.benchmarks.pareto_report import print_table, print_targets
from tests.benchmarks.pareto_timings import timings

PEER_SEEDS = range(100, 105)  # the peers': nothing of theirs was tuned, so that any will do
AT_ONCE = 2  # searches beside each other, each on one thread

_problem: Problem  # of a worker process


def search(problem: Problem, method: str, seed: int) -> dict[str, Any]:
    """One search of ours in batches of BATCH, to the last mark: `indices` in order and CPU `seconds`.

    Of a noisy problem also what is `recommended` at each mark.
    """
    explorer = Explorer(problem.space, NAMES, problem.named_limits, seed=seed, method=method)
    factors = problem.factors(seed)
    indices: list[int] = []
    recommended: dict[int, list[int]] = {}  # by mark
    seconds = 0.0
    while len(indices) < problem.marks[-1]:
        begun = time.process_time()
        left = min(mark for mark in problem.marks if mark > len(indices)) - len(indices)
        proposals = explorer.propose(min(BATCH, left))
        if not proposals:
            break
        rows = problem.values[[proposal.index for proposal in proposals]]
        if factors is not None:
            rows = rows * factors[len(indices) : len(indices) + len(rows)]
        explorer.tell([proposal.configuration for proposal in proposals], results_of(rows))
        seconds += time.process_time() - begun
        indices += [proposal.index for proposal in proposals]
        if factors is not None and len(indices) in problem.marks:
            recommended[len(indices)] = _front(explorer)
    for mark in problem.marks if factors is not None else ():
        recommended.setdefault(mark, _front(explorer))  # a search may end by itself before
    run: dict[str, Any] = {"indices": indices, "seconds": seconds}
    return run | {"recommended": recommended} if recommended else run


def _front(explorer: Explorer) -> list[int]:
    return [explorer.space.encode(item.configuration) for item in explorer.recommended()]


def _work_on(problem: Problem) -> None:
    global _problem
    _problem = problem


def _run(name: str, seed: int) -> dict[str, Any]:
    """One run of the method or peer of that name, in a worker process."""
    if name in METHODS:
        return search(_problem, name, seed)
    return peers.run(_problem, next(peer for peer in peers.PEERS if peer.name == name), seed)


def compare(problem: Problem, plan: dict[str, list[int]]) -> list[dict[str, Any]]:
    """Run each name's seeds and return a row for each name."""
    with ProcessPoolExecutor(
        AT_ONCE, mp_context=get_context("spawn"), initializer=_work_on, initargs=(problem,)
    ) as pool:
        running: dict[str, list[Future[dict[str, Any]]]] = {
            name: [pool.submit(_run, name, seed) for seed in seeds] for name, seeds in plan.items()
        }
        return [
            summarise(problem, name, plan[name], [future.result() for future in futures])
            for name, futures in running.items()
        ]


def summarise(problem: Problem, name: str, seeds: list[int], runs: list[dict[str, Any]]) -> dict[str, Any]:
    """What is reported of one method's or peer's runs; `failed` with a reason where any of them did.

    `regret` by reference, mark and seed; CPU milliseconds a suggestion; the shares of evaluations that were
    `duplicates`; how many suggestions were `refused` by known constraints.
    """
    row: dict[str, Any] = {"name": name, "seeds": seeds}
    if not runs:
        return row | {"failed": "no run is stored"}
    if failures := [run["failed"] for run in runs if "failed" in run]:
        return row | {"failed": failures[0]}
    counts = [len(run["indices"]) for run in runs]
    row["cpu_ms"] = 1e3 * float(np.mean([run["seconds"] / n for run, n in zip(runs, counts, strict=True)]))
    row["duplicates"] = float(np.mean([1 - len(set(run["indices"])) / len(run["indices"]) for run in runs]))
    row["refused"] = float(np.mean([run.get("refused", 0) for run in runs]))
    row["versions"] = runs[0].get("versions")
    # A search that ended by itself stays where it was; one that was given less is not measured there.
    given = peers.budget_of(problem, name)
    marks = [mark for mark in problem.marks if mark <= given]
    pairs = list(zip(seeds, runs, strict=True))

    def regrets(chosen: Callable[[int, dict[str, Any], int], list[int]]) -> dict[str, Any]:
        return {
            reference: {
                mark: [problem.regret(chosen(seed, run, mark), reference) for seed, run in pairs]
                for mark in marks
            }
            for reference in problem.references
        }

    row["regret"] = regrets(lambda seed, run, mark: _recommended(problem, seed, run, mark))
    if problem.noise:
        row["discovered"] = regrets(lambda _, run, mark: run["indices"][:mark])
    return row


def _recommended(problem: Problem, seed: int, run: dict[str, Any], mark: int) -> list[int]:
    """What a run recommends after so many evaluations."""
    if "recommended" in run:
        return run["recommended"][mark]
    return problem.measured_front(run["indices"][:mark], seed)


def main() -> None:
    parser = argparse.ArgumentParser(description="The searches of pareto beside other optimisers.")
    parser.add_argument("--quick", action="store_true", help="two seeds, only peers that take seconds")
    parser.add_argument("--cheap", action="store_true", help="only peers that take seconds")
    parser.add_argument("--stored", action="store_true", help="of the peers, only what is kept")
    parser.add_argument("--fresh", action="store_true", help="run the peers again, too")
    parser.add_argument("--only", metavar="TEXT", default="", help="problems whose name contains TEXT")
    parser.add_argument("--seeds", type=int, default=len(SEEDS), help="how many (5)")
    arguments = parser.parse_args()
    count = 2 if arguments.quick else arguments.seeds
    seeds, peer_seeds = SEEDS[:count], PEER_SEEDS[:count]
    os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"))
    data = os.environ.get("FRONTRUNNER_DATA")

    chosen = [peer for peer in peers.PEERS if peer.most >= 500 or not (arguments.cheap or arguments.quick)]
    absent: dict[str, str] = {}
    if not arguments.stored:
        absent = {peer.name: reason for peer in chosen if (reason := peers.missing(peer.packages))}
    present = [peer for peer in chosen if peer.name not in absent]
    if arguments.fresh:
        peers.forget()
    results = []
    for problem in problems(Path(data) if data else None):
        if arguments.only not in problem.name:
            continue
        plan = {name: list(seeds) for name in METHODS}
        for peer in present:
            kept = [seed for seed in peer_seeds if peers.stored(problem, peer, seed).exists()]
            plan[peer.name] = kept if arguments.stored else list(peer_seeds)
        rows = compare(problem, plan)
        rows += [{"name": name, "failed": reason} for name, reason in absent.items()]
        results.append(
            {
                "problem": problem.name,
                "points": len(problem.space),
                "limits": problem.limits,
                "references": problem.references,
                "marks": problem.marks,
                "rows": rows,
            }
        )
        print_table(results[-1])
    if not data:
        print("BlackScholes, convolution: not measured, FRONTRUNNER_DATA is not set")
    intervals.report(arguments.only, count)
    timed = timings()
    print_targets(results, timed, ours=DEFAULT)
    target = peers.DATA / "pareto.json"
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(json.dumps({"problems": results, "timings": timed}, indent=1) + "\n", encoding="utf-8")
    print(f"written to {target}")


if __name__ == "__main__":
    sys.exit(main())
