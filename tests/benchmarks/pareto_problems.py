"""The problems on which search methods are compared: all their points are known, so regret is exact."""

from __future__ import annotations

import csv
import hashlib
import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pareto import Scenario, Space
from pareto.errors import EvaluationError
from pareto.fronts.front import nondominated
from pareto.fronts.hypervolume import hypervolume
from pareto.measuring.table import from_table
from tests.benchmarks import synthetic_kernel, synthetic_kfusion
from tests.builders.convolution import CONSTRAINTS

ROOT = Path(__file__).parents[2]
SEEDS = range(930, 935)  # ours: never looked at while the methods were developed
BATCH = 20
NAMES = ("first", "second")


@dataclass(frozen=True)
class Problem:
    """A space, the (points, 2) minimised values of all its points, NaN where one fails, and what is given.

    `limits` are those of the search. `references` are the points from which hypervolume is counted, by
    what they mean: the limits, or the worst values of the whole table. Never does one come from the front.
    With `noise`, a standard deviation of logarithms, each measurement is a value times a random factor; a
    search is judged by the values themselves.
    """

    name: str
    space: Space
    values: NDArray[np.float64]
    limits: tuple[float, ...] | None
    references: dict[str, tuple[float, ...]]
    marks: tuple[int, ...]
    noise: float = 0.0

    @cached_property
    def digest(self) -> str:
        """SHA-256 of everything that a search can notice."""
        content = hashlib.sha256(np.ascontiguousarray(self.values).tobytes())
        described = [self.space.to_dict(), self.limits, *([self.noise] if self.noise else [])]
        content.update(json.dumps(described, sort_keys=True).encode())
        return content.hexdigest()

    def factors(self, seed: int) -> NDArray[np.float64] | None:
        """The (evaluations, 2) factors of the measurements of one search, or None without noise."""
        if not self.noise:
            return None
        return np.exp(self.noise * np.random.default_rng(seed).normal(size=(self.marks[-1], 2)))

    def noisy(self, noise: float) -> Problem:
        """The same problem with noise in each measurement."""
        return replace(self, name=f"{self.name}, {100 * noise:g} % noise", noise=noise, marks=(200, 500))

    @property
    def named_limits(self) -> dict[str, float] | None:
        """`limits` as a search takes them."""
        return None if self.limits is None else dict(zip(NAMES, self.limits, strict=True))

    @cached_property
    def front(self) -> NDArray[np.float64]:
        """The values of the exhaustive front, over all points that do not fail."""
        good = self.values[~np.isnan(self.values).any(axis=1)]
        return good[nondominated(good)]

    def measured_front(self, indices: list[int], seed: int) -> list[int]:
        """Return which of `indices` are non-dominated as the search of that seed measured them.

        Of what was measured more than once, the mean counts, as every search that keeps a table would take.
        """
        factors = self.factors(seed)
        measured = self.values[indices]
        if factors is not None:
            measured = measured * factors[: len(indices)]
        places, inverse, counts = np.unique(indices, return_inverse=True, return_counts=True)
        means = np.zeros((len(places), measured.shape[1]))
        np.add.at(means, inverse, measured)
        means /= counts[:, None]
        good = ~np.isnan(means).any(axis=1)
        if self.limits is not None:
            good &= (means <= self.limits).all(axis=1)
        return places[good][nondominated(means[good])].tolist()

    def regret(self, indices: list[int], reference: str) -> float:
        """Return 1 - HV / HV* in log objectives: what `indices` leave uncovered of the front's volume."""
        point = np.array(self.references[reference])
        found = self.values[indices]
        found = found[~np.isnan(found).any(axis=1)]
        return 1.0 - hypervolume(found, point, log=True) / hypervolume(self.front, point, log=True)


def results_of(rows: NDArray[np.float64]) -> list[dict[str, float] | None]:
    """`rows` of values (n, 2) as a search takes them, None for those that failed."""
    return [None if np.isnan(row).any() else dict(zip(NAMES, row, strict=True)) for row in rows]


def kfusion(with_limits: bool, rough: bool = True) -> Problem:
    """The made-up KinectFusion. The limits, 5 cm and the default's runtime, bound the score in any case."""
    space = Space.load(ROOT / "pareto" / "spaces" / "kfusion.json")
    values = synthetic_kfusion.evaluate(space, np.arange(len(space)), rough=rough)
    bounds = (0.05, float(values[space.encode(space.default), 1]))
    references = {"limits": bounds}
    if not with_limits:
        references["worst"] = _worst(values)
    name = "kfusion, " + ("limits" if with_limits else "no limits") + ("" if rough else ", smooth")
    return Problem(name, space, values, bounds if with_limits else None, references, (200, 500, 1000))


def kernel() -> Problem:
    """The made-up kernel generator, without limits."""
    values = synthetic_kernel.evaluate(np.arange(len(synthetic_kernel.SPACE)))
    worst = {"worst": _worst(values)}
    return Problem("kernel", synthetic_kernel.SPACE, values, None, worst, (200, 500, 1000))


def black_scholes(folder: Path) -> Problem:
    """HyperMapper's exhaustive table: validity is learnt from failures, no limits are given."""
    scenario = Scenario.load(folder / "BlackScholes_scenario.json")
    table = folder / "BlackScholes_exhaustive_search_data.csv"
    look_up = from_table(table, scenario.space, scenario.objectives, scenario.feasible)
    values = np.full((len(scenario.space), 2), np.nan)
    for index in range(len(values)):
        try:
            values[index] = list(look_up(scenario.space.decode(index)).values())
        except EvaluationError:
            continue
    worst = {"worst": _worst(values)}
    return Problem("BlackScholes", scenario.space, values, None, worst, (200, 500))


def convolution(folder: Path, with_constraints: bool) -> Problem:
    """One kernel's time on two GPUs, over the product of the values that occur: 10,240 points.

    What the table lacks, or either device could not run, fails. `with_constraints`: the restrictions of the
    kernel, which leave 4,362 points, are known constraints; otherwise they must be learnt from failures.
    """
    tables = []
    for device in ("A100", "A4000"):
        with (folder / f"convolution_{device}.csv").open(newline="", encoding="utf-8") as file:
            tables.append(list(csv.DictReader(file)))
    names = list(tables[0][0])[:10]
    parameters = []
    for name in names:
        values = sorted({int(row[name]) for row in tables[0]})
        parameters.append({"name": name, "type": "ordinal", "values": values})
    description: dict[str, Any] = {"name": "convolution", "parameters": parameters}
    space = Space.from_dict(description | ({"constraints": CONSTRAINTS} if with_constraints else {}))
    values = np.full((len(space), 2), np.nan)
    for column, rows in enumerate(tables):
        for row in rows:
            try:
                time = float(row["time"])
            except ValueError:  # the name of an error
                continue
            values[space.index_of({name: int(row[name]) for name in names}), column] = time
    values[np.isnan(values).any(axis=1)] = np.nan
    name = "convolution, " + ("constraints" if with_constraints else "no constraints")
    return Problem(name, space, values, None, {"worst": _worst(values)}, (200, 500))


def problems(data: Path | None) -> Iterator[Problem]:
    """Every problem there is; the measured tables only where `data`, a folder of shared data, is given."""
    yield kfusion(with_limits=True)
    yield kfusion(with_limits=False)
    yield kfusion(with_limits=True, rough=False)
    yield kfusion(with_limits=True, rough=False).noisy(0.02)
    yield kfusion(with_limits=False, rough=False)
    if data is not None:
        yield black_scholes(data / "dse" / "hypermapper")
        yield black_scholes(data / "dse" / "hypermapper").noisy(0.05)
        yield convolution(data / "dse" / "convolution", with_constraints=False)
        yield convolution(data / "dse" / "convolution", with_constraints=True)
    yield kernel()


def _worst(values: NDArray[np.float64]) -> tuple[float, ...]:
    return tuple(np.nanmax(values, axis=0).tolist())
