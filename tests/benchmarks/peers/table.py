"""What every peer is given: a problem as a table of all its points, and a budget of look-ups.

A request is a JSON file: `space` (as pareto's spaces are written), `values` (path of an .npy of (points,
objectives), NaN where a point fails, the last parameter varying fastest), `limits` (one a objective, or
null), `allowed` (path of an .npy mask of the points, or null), `factors` (path of an .npy of (evaluations,
objectives) by which the measurements are multiplied, or null), `budget`, `seed` and `method`. The answer, one
JSON object on the last line of standard output, lists the `indices` in the order they were evaluated,
duplicates included, how many points were `refused`, and the CPU `seconds` of the search.
"""

from __future__ import annotations

import contextlib
import importlib.metadata
import json
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

PATIENCE = 50  # points that may be refused for each that is evaluated


class BudgetSpentError(BaseException):
    """The look-up after the last one that was allowed: a search that plans in generations ends here.

    No Exception: a search that goes on after a failing point must not go on after this.
    """


@dataclass(frozen=True)
class Outcome:
    """Logarithms of the objectives (stand-ins, if it failed), and by how much each limit is exceeded.

    `excess` is in logarithms, at most 0 where a limit is kept, and 1 everywhere for a failed point; without
    limits its one entry tells whether the point failed. `feasible`: measured, and within the limits.
    """

    objectives: tuple[float, ...]
    excess: tuple[float, ...]
    feasible: bool


class Table:
    """The problem, seen by position of each value in its parameter's list; keeps the order of look-ups."""

    def __init__(self, request: dict) -> None:
        parameters = request["space"]["parameters"]
        self.shape = tuple(len(parameter["values"]) for parameter in parameters)
        self.axes = {p["name"]: n for n, p in enumerate(parameters) if len(p["values"]) > 1}
        self.ordered = {p["name"]: p["type"] != "categorical" for p in parameters}
        self.default = {
            p["name"]: p["values"].index(p["default"]) for p in parameters if p["name"] in self.axes
        }
        self.logarithms = np.log(np.load(request["values"]))
        self.limits = None if request["limits"] is None else np.log(request["limits"])
        self.can_fail = bool(np.isnan(self.logarithms).any())
        self.allowed = None if request["allowed"] is None else np.load(request["allowed"])
        self.noise = None if request["factors"] is None else np.log(np.load(request["factors"]))
        self.budget, self.seed, self.method = request["budget"], request["seed"], request["method"]
        # For searches that need to know their end: refused points must not shorten them.
        self.trials = self.budget * (1 if self.allowed is None else PATIENCE)
        self.indices: list[int] = []
        self.refused = 0
        self._worst = np.full(self.logarithms.shape[1], -np.inf)

    @property
    def objectives(self) -> int:
        """How many there are."""
        return self.logarithms.shape[1]

    @property
    def constraints(self) -> int:
        """How many entries `excess` has that can ever be positive."""
        return self.objectives if self.limits is not None else int(self.can_fail)

    def size(self, name: str) -> int:
        """The number of values of a parameter."""
        return self.shape[self.axes[name]]

    def evaluate(self, positions: dict[str, int]) -> Outcome:
        """Look one configuration up. Raises BudgetSpentError when nothing is left.

        What a known constraint forbids counts for nothing and looks like a failure: few of these searches can
        be given such constraints, but all of them can propose again.
        """
        if len(self.indices) >= self.budget:
            raise BudgetSpentError
        codes = [0] * len(self.shape)
        for name, axis in self.axes.items():
            codes[axis] = int(positions[name])
        index = int(np.ravel_multi_index(codes, self.shape))
        if self.allowed is not None and not self.allowed[index]:
            self.refused += 1
            if self.refused > PATIENCE * self.budget:
                raise BudgetSpentError
            return self._failed()
        self.indices.append(index)
        row = self.logarithms[index]
        if self.noise is not None:
            row = row + self.noise[len(self.indices) - 1]
        if np.isnan(row).any():
            return self._failed()
        self._worst = np.maximum(self._worst, row)
        excess = [-1.0] if self.limits is None else (row - self.limits).tolist()
        return Outcome(tuple(row.tolist()), tuple(excess), max(excess) <= 0)

    def _failed(self) -> Outcome:
        # A failed point says nothing, but these searches want a number: the worst that was seen, or that
        # there is as long as nothing else was seen.
        worst = self._worst
        if not np.isfinite(worst).all():
            worst = np.nanmax(self.logarithms, axis=0)
        return Outcome(tuple(worst.tolist()), (1.0,) * max(self.constraints, 1), False)


def answer(search: Callable[[Table], None], packages: Sequence[str]) -> None:
    """Read the request named on the command line, search, and print the answer."""
    table = Table(json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")))
    begun = time.process_time()
    with contextlib.suppress(BudgetSpentError):
        search(table)
    spent = time.process_time() - begun
    versions = {package: importlib.metadata.version(package) for package in packages}
    result = {"indices": table.indices, "refused": table.refused, "seconds": spent, "versions": versions}
    sys.__stdout__.write("\n" + json.dumps(result) + "\n")
